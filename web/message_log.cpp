#include "web/message_log.h"

#include <charconv>
#include <chrono>

namespace lampglow::web {
namespace {

std::string new_run_id() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return std::to_string(std::chrono::duration_cast<std::chrono::milliseconds>(now).count());
}

}  // namespace

std::optional<StreamPosition> parse_stream_id(std::string_view id) {
  const size_t first = id.find('-');
  const size_t second = first == std::string_view::npos ? first : id.find('-', first + 1);
  if (second == std::string_view::npos) return std::nullopt;
  StreamPosition out{std::string(id.substr(0, first)), 0, {}};
  std::int64_t time_ms = 0;
  const auto whole = [](std::string_view text, auto& value) {
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    return error == std::errc{} && end == text.data() + text.size();
  };
  constexpr std::int64_t kLastMs = 253402300799999;  // year 9999
  if (!whole(id.substr(first + 1, second - first - 1), out.sequence) ||
      !whole(id.substr(second + 1), time_ms) || time_ms < 0 || time_ms > kLastMs)
    return std::nullopt;
  out.time_utc = TimePoint{std::chrono::milliseconds{time_ms}};
  return out;
}

MessageLog::MessageLog(int most) : most_(most), run_id_(new_run_id()) {}

void MessageLog::add(const std::string& type, TimePoint time_utc, const std::string& data) {
  auto message = std::make_shared<StreamMessage>();
  message->sequence = ++sequence_;
  message->wire = "id: " + run_id_ + "-" + std::to_string(sequence_) + "-" +
                  std::to_string(time_utc.time_since_epoch().count()) + "\nevent: " + type +
                  "\ndata: " + data + "\n\n";
  kept_.push_back(std::move(message));
  while (std::ssize(kept_) > most_) kept_.pop_front();
}

std::optional<std::vector<std::shared_ptr<const StreamMessage>>> MessageLog::after(
    std::uint64_t after) const {
  const std::uint64_t first_kept = kept_.empty() ? sequence_ + 1 : kept_.front()->sequence;
  if (after > sequence_ || after + 1 < first_kept) return std::nullopt;
  const auto missed = static_cast<std::ptrdiff_t>(after + 1 - first_kept);
  return std::vector(kept_.begin() + missed, kept_.end());
}

}  // namespace lampglow::web
