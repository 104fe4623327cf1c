#include "daemon/sources/fault.h"

#include <algorithm>
#include <array>

namespace lampglow::daemon {
namespace {

using enum Fault;
using Q = Quality;
constexpr std::optional<Quality> kNoFlag;

constexpr std::array kRegistry{
    FaultInfo{none, "none", "All is well.", kNoFlag},
    FaultInfo{name_not_found, "name_not_found",
              "The host's name is not known: check the address and the DNS.", Q::frame_missing},
    FaultInfo{connection_refused, "connection_refused",
              "The host answers, but nothing listens on this port: check port and camera service.",
              Q::frame_missing},
    FaultInfo{unreachable, "unreachable", "There is no way to the host: check cable, power and address.",
              Q::frame_missing},
    FaultInfo{connect_timeout, "connect_timeout", "The host did not answer in time: check power and address.",
              Q::frame_missing},
    FaultInfo{connection_lost, "connection_lost", "The connection broke while the picture was on its way.",
              Q::frame_missing},
    FaultInfo{stalled, "stalled", "The camera is connected but sends nothing.", Q::frame_missing},
    FaultInfo{too_slow, "too_slow", "The camera sends too slowly for the picture to arrive in time.",
              Q::frame_missing},
    FaultInfo{unauthorised, "unauthorised",
              "The camera refuses user or password: check the credentials file.", Q::frame_missing},
    FaultInfo{no_credentials, "no_credentials", "The credentials file is missing, unreadable or malformed.",
              Q::frame_missing},
    FaultInfo{http_error, "http_error", "The camera answers with an HTTP error status: check the path.",
              Q::frame_missing},
    FaultInfo{redirect_loop, "redirect_loop",
              "The camera redirects more often than allowed: check the address.", Q::frame_missing},
    FaultInfo{too_large, "too_large", "The picture has more bytes or pixels than allowed.",
              Q::frame_too_large},
    FaultInfo{tls_expired, "tls_expired", "The camera's certificate has expired or is not yet valid.",
              Q::frame_missing},
    FaultInfo{tls_untrusted, "tls_untrusted",
              "The camera's certificate is from nobody we trust, or for another name: give its CA file.",
              Q::frame_missing},
    FaultInfo{tls_error, "tls_error", "The encrypted connection could not be made.", Q::frame_missing},
    FaultInfo{protocol_error, "protocol_error", "The camera's answer breaks its own protocol.",
              Q::frame_missing},
    FaultInfo{stream_ended, "stream_ended", "The camera ended its stream.", Q::frame_missing},
    FaultInfo{no_key_frame, "no_key_frame",
              "No clean key frame came in time: set a shorter key frame interval.", Q::frame_missing},
    FaultInfo{device_missing, "device_missing", "There is no such device: check cable and the by-path name.",
              Q::frame_missing},
    FaultInfo{device_unplugged, "device_unplugged", "The device went away while in use.", Q::frame_missing},
    FaultInfo{device_busy, "device_busy", "Another program holds the device.", Q::frame_missing},
    FaultInfo{device_denied, "device_denied",
              "No permission to open the device: add the user to group video.", Q::frame_missing},
    FaultInfo{device_timeout, "device_timeout", "The device gave no frame in time.", Q::frame_missing},
    FaultInfo{device_error, "device_error", "The device's driver reports an error.", Q::frame_missing},
    FaultInfo{format_unsupported, "format_unsupported", "The camera has no pixel format that we can read.",
              Q::frame_undecodable},
    FaultInfo{not_locked, "not_locked", "Exposure, gain or white balance did not stay where they were set.",
              Q::camera_not_locked},
    FaultInfo{not_an_image, "not_an_image", "What came is not a JPEG, PNG or TIFF picture.",
              Q::frame_undecodable},
    FaultInfo{torn, "torn", "The picture is incomplete: cut off or damaged on its way.", Q::frame_truncated},
    FaultInfo{undecodable, "undecodable", "The picture can't be decoded.", Q::frame_undecodable},
    FaultInfo{grey, "grey", "A large part of the picture is flat grey, as of a decoder without data.",
              Q::frame_blank},
    FaultInfo{black, "black", "The whole picture has one value: lens cap, dead sensor or a placeholder.",
              Q::frame_blank},
    FaultInfo{frozen, "frozen", "The camera repeats the same picture, bit for bit.", Q::frame_frozen},
    FaultInfo{resolution_changed, "resolution_changed", "The picture's size changed while running.",
              Q::frame_wrong_size},
    FaultInfo{wrong_size, "wrong_size", "The picture's size is not the site file's.", Q::frame_wrong_size},
    FaultInfo{file_unreadable, "file_unreadable", "A picture file or its folder can't be read.",
              Q::frame_missing},
    FaultInfo{no_new_file, "no_new_file", "No new picture file was put into the folder in time.",
              Q::frame_missing},
    FaultInfo{clock_stepped, "clock_stepped", "The system's clock jumped.", Q::clock_unsynchronised},
    FaultInfo{clock_unsynchronised, "clock_unsynchronised", "The system's clock is not held by NTP.",
              Q::clock_unsynchronised},
    FaultInfo{slot_missed, "slot_missed", "The camera was still busy when this picture was due.",
              Q::frame_missing},
    FaultInfo{stopped, "stopped", "The daemon was told to stop before the picture came.", Q::frame_missing},
    FaultInfo{internal, "internal", "A bug in lampglow; the log has more.", Q::internal_error},
};

}  // namespace

std::span<const FaultInfo> fault_registry() {
  return kRegistry;
}

const FaultInfo& fault_info(Fault fault) {
  const auto* found = std::ranges::find(kRegistry, fault, &FaultInfo::fault);
  return found != kRegistry.end() ? *found : kRegistry.back();
}

std::string_view to_string(Fault fault) {
  return fault_info(fault).name;
}

std::optional<Fault> parse_fault(std::string_view name) {
  const auto* found = std::ranges::find(kRegistry, name, &FaultInfo::name);
  return found != kRegistry.end() ? std::optional(found->fault) : std::nullopt;
}

}  // namespace lampglow::daemon
