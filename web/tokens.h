// Bearer tokens. Only their SHA-256 is ever kept: a token is 256 random bits, so a plain hash is enough.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace lampglow::web {

// 43 characters of base64url from the system's random numbers.
std::string new_token();

// 64 hexadecimal digits.
std::string token_hash(std::string_view token);

// Whether the Authorization header's value is "Bearer TOKEN" with a token of one of these hashes. Takes the
// same time wherever they differ.
bool token_allowed(std::string_view authorization, const std::vector<std::string>& hashes);

}  // namespace lampglow::web
