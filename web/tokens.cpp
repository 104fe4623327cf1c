#include "web/tokens.h"

#include <openssl/crypto.h>
#include <openssl/rand.h>
#include <openssl/sha.h>

#include <algorithm>
#include <array>
#include <stdexcept>

namespace lampglow::web {

std::string new_token() {
  std::array<unsigned char, 32> bytes{};
  if (RAND_bytes(bytes.data(), static_cast<int>(bytes.size())) != 1)
    throw std::runtime_error("no random numbers from OpenSSL");
  constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_";
  std::string out;
  unsigned bits = 0, held = 0;
  for (const unsigned char byte : bytes) {
    bits = (bits << 8) | byte;
    for (held += 8; held >= 6; held -= 6) out += kDigits[(bits >> (held - 6)) & 63];
  }
  return out + kDigits[(bits << (6 - held)) & 63];
}

std::string token_hash(std::string_view token) {
  std::array<unsigned char, SHA256_DIGEST_LENGTH> digest{};
  std::string copy(token);
  SHA256(static_cast<const unsigned char*>(static_cast<const void*>(copy.data())), copy.size(),
         digest.data());
  constexpr char kHex[] = "0123456789abcdef";
  std::string out;
  for (const unsigned char byte : digest) {
    out += kHex[byte >> 4];
    out += kHex[byte & 15];
  }
  return out;
}

bool token_allowed(std::string_view authorization, const std::vector<std::string>& hashes) {
  constexpr std::string_view kScheme = "bearer ";  // a scheme's case does not matter (RFC 9110, 11.1)
  const auto same = [](char given, char known) { return (given | 0x20) == (known | 0x20); };
  if (authorization.size() < kScheme.size() ||
      !std::equal(kScheme.begin(), kScheme.end(), authorization.begin(), same))
    return false;
  const std::string hash = token_hash(authorization.substr(kScheme.size()));
  bool allowed = false;
  for (const std::string& known : hashes)
    if (known.size() == hash.size() && CRYPTO_memcmp(known.data(), hash.data(), hash.size()) == 0)
      allowed = true;
  return allowed;
}

}  // namespace lampglow::web
