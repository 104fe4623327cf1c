// The writer: one per database and one thread at a time. Readers (storage/reader.h) may run beside it.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>

#include "estimator/observation.h"
#include "estimator/site.h"
#include "storage/error.h"
#include "storage/records.h"

namespace lampglow::storage {

struct ReferenceRecord;  // storage/references.h

struct StoreOptions {
  int batch_frames = 64;  // put() commits by itself after so many frames; 1: every frame, for a live station
  int busy_timeout_ms = 5000;  // how long to wait for a lock that another process holds
  bool keep_ring_profiles = true;
};

// What retention tells apart.
enum class Kept { frames, observations, fits, ring_profiles, one_minute, ten_minutes, hours, events };

class Store {
 public:
  // Opens the database, makes it if there is none, and migrates an older one. WAL, synchronous NORMAL,
  // incremental auto-vacuum, foreign keys on. Throws StorageError; `stopped` soon after a stop was asked for
  // while it migrates.
  explicit Store(const std::filesystem::path& file, const StoreOptions& options = {},
                 const std::stop_token& stop = {});
  ~Store();  // commits what is pending; errors are lost here, so call commit() first
  Store(Store&&) noexcept;
  Store& operator=(Store&&) noexcept;

  // The camera of that name, made if there is none, with its site's place and lamps as they are now. Lamps
  // that moved or got another distance have a new reference entry from the next frame on.
  CameraNumber upsert_camera(const std::string& name, const Site& site);

  // Stores a frame's whole result: frame record, observation, per-lamp fits, ring profiles. A frame of the
  // same camera and time is replaced, so that storing twice is storing once. Means of the touched periods are
  // renewed at the commit. The content depends on the frames and their order alone.
  void put(CameraNumber camera, const FrameResult& result);

  // Stores an event at once (with what is pending) and returns its number.
  std::int64_t put_event(const Event& event);

  // Stores a clear reference at once (with what is pending) and returns its number.
  std::int64_t put_reference(CameraNumber camera, const ReferenceRecord& reference);

  // Notes a kept picture; the file is the caller's.
  void put_picture(CameraNumber camera, const PictureRecord& picture);
  void erase_picture(const PictureRecord& picture);

  void commit();
  // Drops what is pending, after an error (disk full), so that the next put() starts afresh.
  void rollback() noexcept;
  int pending_frames() const;

  // Moves the WAL into the database and truncates it, with a sync: what a power cut can lose is what came
  // after. Waits for nobody. False: a reader held up a part, and it is to be tried again; what a power cut
  // can lose is the same.
  bool checkpoint();

  // Drops up to `max_rows` of the oldest rows before `before` (of each camera); returns how many went.
  int drop_before(Kept what, TimePoint before, int max_rows);
  // Gives up to so many free pages back to the file system.
  void release_pages(int most);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lampglow::storage
