// One function for each path of the interface. Included by this folder's .cpp files only.
#pragma once

#include <map>
#include <string>

#include "storage/reader.h"
#include "web/api.h"
#include "web/http.h"
#include "web/live_state.h"
#include "web/query.h"

namespace lampglow::web {

struct Call {
  const Request& request;
  const Target& target;
  const Query& query;
  const std::map<std::string, std::string>& path;  // values of the route's {names}
  LiveState& live;
  storage::Reader* reader;  // for routes of kind database, null without a database
  const ApiOptions& options;
  bool trusted;  // everything is open, or a token was shown
};

Response current(const Call& call);
Response observations(const Call& call);
Response cameras(const Call& call);
Response lights(const Call& call);
Response light_profile(const Call& call);
Response latest_frame(const Call& call);
Response stored_frames(const Call& call);
Response stored_frame(const Call& call);
Response events(const Call& call);
Response stream_head(const Call& call);
Response healthz(const Call& call);
Response readyz(const Call& call);
Response metrics(const Call& call);
Response openapi(const Call& call);

// The dashboard's files; 404 for anything else.
Response static_answer(const Request& request, const std::string& path);

Response json_answer(std::string body, int max_age_s = 0);
// Gives the answer its ETag, and turns it into a 304 if the client has it.
Response with_etag(Response response, const Request& request, const std::string& etag);
std::string hash_etag(std::string_view body);
// The camera that the query asks for, or the default one; throws NotFound.
storage::CameraRecord camera_of(const Call& call);

struct NotFound : std::runtime_error {
  using std::runtime_error::runtime_error;
};

}  // namespace lampglow::web
