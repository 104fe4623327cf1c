// The station's inside, in three files: station.cpp starts and ends it, station_cameras.cpp brings cameras
// in, changes and removes them, station_frames.cpp has what happens to a frame. Included by these alone.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <semaphore>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "daemon/station/backups.h"
#include "daemon/station/bounded_queue.h"
#include "daemon/station/estimating.h"
#include "daemon/station/feed.h"
#include "daemon/station/keeper.h"
#include "daemon/station/picture_keeper.h"
#include "daemon/station/station.h"
#include "daemon/station/teacher.h"
#include "daemon/station/work_watch.h"
#include "web/live_state.h"
#include "web/server.h"

namespace lampglow::daemon {

// A camera that could take pictures, but is not in the station yet.
struct Opened {
  std::shared_ptr<const CameraSetup> setup;
  std::unique_ptr<Feed> feed;
};

inline TimePoint utc_time() {
  return std::chrono::floor<std::chrono::milliseconds>(std::chrono::system_clock::now());
}

inline std::size_t worker_count(const StationConfig& config) {
  return config.workers ? config.workers : std::max(1U, std::thread::hardware_concurrency());
}

struct Station::Impl {
  Impl(const StationConfig& given, const std::stop_token& stop);

  void start();
  void stop();
  void work();
  void bound_drain();
  void write();
  void take(Done done);
  bool note_fog(const Done& done);  // whether fog began
  void tell(storage::Event event);  // from any thread: stored, logged, streamed
  Opened open_camera(const CameraConfig& camera, const std::stop_token& stop);
  void install_camera(const CameraConfig& camera, Opened opened);
  void put_in_force(const std::shared_ptr<const CameraSetup>& setup);
  void adopt(const std::shared_ptr<const CameraSetup>& fresh);
  void let_teach(const Adopted& adopted);
  void adopt_late();
  bool replace(const std::shared_ptr<const CameraSetup>& before,
               const std::shared_ptr<const CameraSetup>& setup);
  void forget_camera(const std::string& name);
  void use_database(const storage::FileId& file);
  void allow_long_step(std::chrono::seconds at_most);
  void note_backup(Backups::Result result, const std::string& message, const storage::FileId& file);
  void take_over(const Taught& taught);
  void close_camera(const std::string& name);
  void restore(const std::string& camera);
  void on_camera_event(const CameraEvent& event);
  void take_over_http(const StationConfig& wanted);
  std::vector<std::string> reload(const StationConfig& wanted, const std::stop_token& stop);

  // Once it runs, the keeper belongs to the writer's thread.
  void by_writer(std::function<void()> work) {
    if (writer.joinable())
      writes.push(std::move(work));
    else
      work();
  }

  // What a camera's feed pushes into; the pool takes from it.
  std::shared_ptr<const CameraSetup> setup_of(const std::string& camera) {
    const std::scoped_lock lock(setups_mutex);
    const auto found = setups.find(camera);
    return found == setups.end() ? nullptr : found->second;
  }

  StationConfig config;
  SystemClock clock;
  web::LiveState live;
  std::unique_ptr<web::Server> server;  // before the keeper, which tells it of its file
  BoundedQueue<Job> jobs;
  BoundedQueue<std::function<void()>> writes{64};
  std::atomic<int> jpeg_quality;
  WorkWatch watch;
  std::mutex setups_mutex;
  std::map<std::string, std::shared_ptr<const CameraSetup>> setups;
  std::map<std::string, std::unique_ptr<Feed>> feeds;  // the main thread's
  std::mutex feeds_mutex;                              // against note_mor from the writer
  std::atomic<std::chrono::steady_clock::rep> writer_moved{0};
  std::atomic<std::chrono::steady_clock::rep> writer_may_take_until{0};
  std::optional<storage::FileId> database_file;
  // The writer thread's, once it runs:
  std::map<std::string, FogWatch> fog;
  Teacher teacher;
  PictureKeeper pictures;
  Keeper keeper;
  Backups backups;
  std::set<std::string> to_adopt;  // cameras whose stored reference could not be read yet
  std::chrono::steady_clock::time_point next_adoption{};
  std::atomic<bool> stopped{false};
  std::stop_source give_up;         // frames that are not measured yet are not going to be
  std::binary_semaphore worked{0};  // the workers have come to their end
  std::jthread workers;
  std::jthread writer;
};

}  // namespace lampglow::daemon
