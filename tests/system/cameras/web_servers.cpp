#include "tests/system/cameras/web_servers.h"

#include <fmt/format.h>
#include <openssl/evp.h>

namespace lampglow::testing {
namespace {

std::string md5_hex(const std::string& text) {
  unsigned char digest[16];
  unsigned int size = 0;
  EVP_Digest(text.data(), text.size(), digest, &size, EVP_md5(), nullptr);
  std::string hex;
  for (const unsigned char byte : digest) hex += fmt::format("{:02x}", byte);
  return hex;
}

std::string sha1_base64(const std::string& text) {
  unsigned char digest[20], base64[32];
  unsigned int size = 0;
  EVP_Digest(text.data(), text.size(), digest, &size, EVP_sha1(), nullptr);
  const int length = EVP_EncodeBlock(base64, digest, static_cast<int>(size));
  return {base64, base64 + length};
}

}  // namespace

Lighttpd::Lighttpd(const fs::path& folder) : folder_(folder), port_(free_port()) {
  fs::create_directories(folder_ / "www/open");
  fs::create_directories(folder_ / "www/secret");
  write_file(folder_ / "users", "admin:camera:" + md5_hex("admin:camera:" + kPassword) + "\n");
  write_file(folder_ / "lighttpd.conf", fmt::format(R"(
server.modules = ("mod_auth", "mod_authn_file", "mod_redirect", "mod_access")
server.document-root = "{0}/www"
server.bind = "127.0.0.1"
server.port = {1}
server.stat-cache-engine = "disable"
mimetype.assign = (".jpg" => "image/jpeg", ".png" => "image/png")
auth.backend = "htdigest"
auth.backend.htdigest.userfile = "{0}/users"
auth.require = ("/secret/" => ("method" => "digest", "realm" => "camera", "require" => "valid-user"))
url.redirect = ("^/loop" => "/loop", "^/moved" => "/open/snapshot.jpg")
)",
                                                    folder_.string(), port_));
  start();
}

void Lighttpd::start() {
  program_ = std::make_unique<Program>(
      std::vector<std::string>{find_program("lighttpd"), "-D", "-f", (folder_ / "lighttpd.conf").string()},
      folder_ / "lighttpd.log");
  wait_for_port(port_);
}

Nginx::Nginx(const fs::path& folder, int certificate_from_days, int certificate_to_days)
    : folder_(folder), port_(free_port()) {
  fs::create_directories(folder_ / "www/secret");
  write_certificate(folder_ / "cert.pem", folder_ / "key.pem", certificate_from_days, certificate_to_days);
  write_file(folder_ / "users", "admin:{SHA}" + sha1_base64(kPassword) + "\n");
  write_file(folder_ / "nginx.conf", fmt::format(R"(
daemon off; master_process off; pid {0}/nginx.pid; error_log {0}/error.log;
events {{}}
http {{
  access_log {0}/access.log;
  client_body_temp_path {0}/t1; proxy_temp_path {0}/t2; fastcgi_temp_path {0}/t3; uwsgi_temp_path {0}/t4; scgi_temp_path {0}/t5;
  server {{
    listen 127.0.0.1:{1} ssl;
    ssl_certificate {0}/cert.pem; ssl_certificate_key {0}/key.pem;
    root {0}/www;
    location /secret/ {{ auth_basic "camera"; auth_basic_user_file {0}/users; }}
    location /plain {{ return 302 http://127.0.0.1:1/; }}
  }}
}}
)",
                                                 folder_.string(), port_));
  program_ = std::make_unique<Program>(
      std::vector<std::string>{find_program("nginx"), "-e", (folder_ / "start.log").string(), "-c",
                               (folder_ / "nginx.conf").string()},
      folder_ / "nginx.log");
  wait_for_port(port_);
}

}  // namespace lampglow::testing
