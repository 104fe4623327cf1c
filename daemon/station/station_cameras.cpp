// Cameras of the station: opened, installed, changed by a reload, removed; and the references they are
// measured against.
#include <map>
#include <set>

#include "daemon/station/log.h"
#include "daemon/station/remembered.h"
#include "daemon/station/station_impl.h"

namespace lampglow::daemon {

using std::chrono::seconds;
using std::chrono::steady_clock;
using storage::EventKind;
using storage::Severity;

// All that can go wrong with a camera's configuration does so here, where nothing has changed yet.
Opened Station::Impl::open_camera(const CameraConfig& camera, const std::stop_token& stop) {
  return {set_up(camera, stop), make_feed(camera, clock,
                                          {[this, name = camera.name](Bracket bracket) {
                                             if (auto known = setup_of(name))
                                               jobs.push({std::move(known), std::move(bracket)});
                                           },
                                           [this](const CameraEvent& event) { on_camera_event(event); }})};
}

void Station::Impl::install_camera(const CameraConfig& camera, Opened opened) {
  live.set_camera(camera.name, camera.site);
  by_writer([this, name = camera.name, site = camera.site] { keeper.add_camera(name, site); });
  adopt(opened.setup);
  const std::scoped_lock lock(feeds_mutex);
  feeds[camera.name] = std::move(opened.feed);
}

void Station::Impl::close_camera(const std::string& name) {
  std::unique_ptr<Feed> feed;
  {
    const std::scoped_lock lock(feeds_mutex);
    feed = std::move(feeds[name]);
    feeds.erase(name);
  }
  if (!feed) return;
  feed->request_stop();
  feed->join();
  live.set_fault("camera " + name, "");
}

// False if a reload has put another one in force meanwhile.
bool Station::Impl::replace(const std::shared_ptr<const CameraSetup>& before,
                            const std::shared_ptr<const CameraSetup>& setup) {
  const std::scoped_lock lock(setups_mutex);
  const auto found = setups.find(before->name);
  if (found == setups.end() || found->second != before) return false;
  found->second = setup;
  return true;
}

void Station::Impl::put_in_force(const std::shared_ptr<const CameraSetup>& setup) {
  const std::scoped_lock lock(setups_mutex);
  setups[setup->name] = setup;
}

// The clear brackets' reference, with what service taught since by the database.
void Station::Impl::adopt(const std::shared_ptr<const CameraSetup>& fresh) {
  const Adopted adopted = adopt_reference(config.database(), fresh, utc_time());
  put_in_force(adopted.setup);
  by_writer([this, adopted] { let_teach(adopted); });
}

// On the writer's thread. Where the database could not be read, what nights have taught is not known: nothing
// must be taught on top of the brackets and stored as the newest.
void Station::Impl::let_teach(const Adopted& adopted) {
  if (!adopted.known) {
    to_adopt.insert(adopted.setup->name);
    teacher.forget(adopted.setup->name);
    return;
  }
  to_adopt.erase(adopted.setup->name);
  if (adopted.to_store) keeper.put_reference(adopted.setup->name, *adopted.to_store);
  teacher.take_over(adopted);
}

// On the writer's thread, once the database can be read after all.
void Station::Impl::adopt_late() {
  const auto now = steady_clock::now();
  if (to_adopt.empty() || !keeper.is_open() || now < next_adoption) return;
  next_adoption = now + seconds(60);
  for (const std::string& camera : std::exchange(to_adopt, {})) {
    const auto setup = setup_of(camera);
    if (!setup) continue;
    const Adopted adopted = adopt_reference(config.database(), setup, utc_time());
    if (replace(setup, adopted.setup)) let_teach(adopted);
  }
}

// So that a restart does not forget what the air is like.
void Station::Impl::restore(const std::string& name) {
  for (const FrameResult& result : last_hour(config.database(), name)) {
    live.restore(name, result);
    fog[name].note(result.observation);  // so that the same fog has no second onset
  }
}

void Station::Impl::forget_camera(const std::string& name) {
  {
    const std::scoped_lock lock(setups_mutex);
    setups.erase(name);
  }
  writes.push([this, name] {
    to_adopt.erase(name);
    teacher.forget(name);
  });
}

// A renewed certificate is in the same files, so they are read anew whatever their names. Throws where they
// are of no use, and has then changed nothing.
void Station::Impl::take_over_http(const StationConfig& wanted) {
  if (!config.http.tls.certificate.empty() && !wanted.http.tls.certificate.empty()) {
    server->set_tls(wanted.http.tls);
    config.http.tls = wanted.http.tls;
  }
  if (config.access == wanted.access) return;
  server->set_access(wanted.access);
  config.access = wanted.access;
}

std::vector<std::string> Station::Impl::reload(const StationConfig& wanted, const std::stop_token& stop) {
  std::vector<std::string> left = needs_restart(config, wanted);
  std::map<std::string, std::string> before;
  for (const CameraConfig& camera : config.cameras) before[camera.name] = camera.fingerprint;
  std::map<std::string, Opened> changed;
  for (const CameraConfig& camera : wanted.cameras)
    if (!before.contains(camera.name) || before[camera.name] != camera.fingerprint)
      changed[camera.name] = open_camera(camera, stop);
  take_over_http(wanted);
  std::set<std::string> wanted_names;
  for (const CameraConfig& camera : wanted.cameras) {
    wanted_names.insert(camera.name);
    if (!changed.contains(camera.name)) {
      if (const auto setup = setup_of(camera.name)) adopt(setup);  // `lampglow reference restore`
      continue;
    }
    close_camera(camera.name);
    install_camera(camera, std::move(changed[camera.name]));
    const std::scoped_lock lock(feeds_mutex);
    feeds[camera.name]->start();
  }
  for (const auto& [name, fingerprint] : before)
    if (!wanted_names.contains(name)) {
      close_camera(name);
      live.set_health(name, {false, "stopped", "no longer in the configuration", {}, {}});
      forget_camera(name);
      left.push_back("camera " + name + " is stopped, but stays in answers until a restart");
    }
  writes.push([this, wanted] {
    keeper.set_retention(wanted.retention);
    keeper.set_checkpoint_every(wanted.checkpoint_every);
    pictures.set_options(wanted.pictures);
    backups.set(wanted.backups_kept, wanted.backup_hour_utc);
  });
  jpeg_quality = wanted.pictures.jpeg_quality;
  config.cameras = wanted.cameras;
  tell({0, utc_time(), EventKind::configuration_changed, Severity::info, "", "configuration reloaded"});
  return left;
}

}  // namespace lampglow::daemon
