// Requests as Beast reads them and answers as they go out, without a socket. Included by this folder's
// server.cpp, which talks over sockets, and by the fuzzer, which does not.
#pragma once

#include <boost/beast/http.hpp>

#include "web/http.h"

namespace lampglow::web {

using RequestParser = boost::beast::http::request_parser<boost::beast::http::string_body>;
using WireRequest = boost::beast::http::request<boost::beast::http::string_body>;

// What is longer is refused, see status_of().
void limit(RequestParser& parser, int max_header_bytes, int max_body_bytes);

Request to_request(const WireRequest& wire);

// The head of the answer with the security headers of every answer, up to and with its empty line. It is
// written out here because Beast's serializer costs more than all the rest of a short answer. `with_length`
// is false for a stream without end.
std::string head_of(const Response& response, unsigned version, bool keep_alive, bool with_length = true);

// What to answer where Beast could not read a request; 0: nothing, the client is gone.
int status_of(const boost::system::error_code& error);

}  // namespace lampglow::web
