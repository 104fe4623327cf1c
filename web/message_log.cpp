#include "web/message_log.h"

#include <algorithm>
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

MessageLog::MessageLog(int most, std::chrono::seconds stale_after)
    : most_(most), stale_after_(stale_after), run_id_(new_run_id()) {}

void MessageLog::add(Message message) {
  message.sequence = ++sequence_;
  kept_.push_back(std::move(message));
  while (std::ssize(kept_) > most_) kept_.pop_front();
}

void MessageLog::add_event(TimePoint time_utc, const std::string& json) {
  add({0, "event", time_utc, {}, json});
}

void MessageLog::add_observation(TimePoint time_utc, FeatureHalves current, std::string past) {
  add({0, "observation", time_utc, std::move(current), std::move(past)});
}

void MessageLog::append(std::string& text, const Message& message, TimePoint now) const {
  text += "id: " + run_id_ + "-" + std::to_string(message.sequence) + "-" +
          std::to_string(message.time_utc.time_since_epoch().count()) + "\nevent: ";
  (text += message.type) += "\ndata: ";
  const auto age = now - message.time_utc;
  if (!message.current.head.empty() && std::chrono::abs(age) <= stale_after_) {
    const auto age_s = std::max<std::int64_t>(0, std::chrono::floor<std::chrono::seconds>(age).count());
    ((text += message.current.head) += std::to_string(age_s)) += message.current.tail;
  } else {
    text += message.data;
  }
  text += "\n\n";
}

std::optional<StreamText> MessageLog::after(std::uint64_t after, TimePoint now) const {
  const std::uint64_t first_kept = kept_.empty() ? sequence_ + 1 : kept_.front().sequence;
  if (after > sequence_ || after + 1 < first_kept) return std::nullopt;
  StreamText out{"", sequence_};
  for (auto i = static_cast<std::size_t>(after + 1 - first_kept); i < kept_.size(); ++i)
    append(out.text, kept_[i], now);
  return out;
}

}  // namespace lampglow::web
