#include "storage/records.h"

namespace lampglow::storage {

std::string_view to_string(EventKind value) {
  switch (value) {
    case EventKind::started:
      return "started";
    case EventKind::stopped:
      return "stopped";
    case EventKind::configuration_changed:
      return "configuration_changed";
    case EventKind::reference_learned:
      return "reference_learned";
    case EventKind::source_failed:
      return "source_failed";
    case EventKind::source_recovered:
      return "source_recovered";
    case EventKind::database_set_aside:
      return "database_set_aside";
    case EventKind::backup_made:
      return "backup_made";
    case EventKind::backup_failed:
      return "backup_failed";
    case EventKind::disk_full:
      return "disk_full";
    case EventKind::clock_stepped:
      return "clock_stepped";
    case EventKind::retention:
      return "retention";
    case EventKind::fog_began:
      return "fog_began";
    case EventKind::fog_ended:
      return "fog_ended";
    case EventKind::database_recovered:
      return "database_recovered";
  }
  return "unknown";
}

std::string_view to_string(Severity value) {
  switch (value) {
    case Severity::info:
      return "info";
    case Severity::warning:
      return "warning";
    case Severity::error:
      return "error";
  }
  return "unknown";
}

std::string_view to_string(KeptFor value) {
  switch (value) {
    case KeptFor::hourly:
      return "hourly";
    case KeptFor::fog_onset:
      return "fog_onset";
  }
  return "unknown";
}

}  // namespace lampglow::storage
