// Relearning in service: the clear references of all cameras from night to night. Used by the writer's
// thread, but for adopt_reference().
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "daemon/station/estimating.h"
#include "estimator/inference/relearner.h"
#include "storage/references.h"

namespace lampglow::daemon {

// What the database knows of a camera's reference, put over what its clear brackets gave.
struct Adopted {
  std::shared_ptr<const CameraSetup> setup;
  std::optional<storage::ReferenceRecord> to_store;  // the database has none, or one of other brackets
  std::vector<FrameResult> tonight;                  // frames since noon that were measured against it
  bool known = true;                                 // false: the database could not be read
};
// The keeper tells of a database that cannot be read.
Adopted adopt_reference(const std::filesystem::path& database,
                        const std::shared_ptr<const CameraSetup>& setup, TimePoint now);

// What a night changed.
struct Taught {
  std::shared_ptr<const CameraSetup> setup;  // with the reference from now on
  storage::ReferenceRecord record;
  storage::Event event;
};

class Teacher {
 public:
  void take_over(const Adopted& adopted);
  void forget(const std::string& camera) { pupils_.erase(camera); }

  // A frame's result in the order of time. Frames that were measured against an earlier reference teach
  // nothing.
  std::optional<Taught> add(const Done& done);
  // About once a second: is a night over without a new frame?
  std::vector<Taught> tick(TimePoint now);

 private:
  struct Pupil {
    std::shared_ptr<const CameraSetup> setup;
    inference::Relearner relearner;
    TimePoint latest{};
  };
  static std::optional<Taught> settle(Pupil& pupil);
  std::map<std::string, Pupil> pupils_;
};

}  // namespace lampglow::daemon
