// A night as it truly is: the lamps, the weather and everything that goes wrong, before any picture is drawn.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "daemon/simulation/window.h"
#include "estimator/observation.h"
#include "estimator/photometry/exposure.h"
#include "estimator/time.h"

namespace lampglow::simulation {

enum class Style {
  bracket,  // 12-bit linear, three exposures, in 16-bit PNG
  webcam,   // one 8-bit sRGB JPEG, saturated lamps, automatic exposure that is not told
};

enum class Luminaire {
  even,    // the same light in all directions
  cutoff,  // a Lambertian disc facing down, over a ground plane of albedo 0.2
  mixed,   // every second lamp of the catalogue is cut-off, all others are even
};

// What disturbs the pictures. All of it is on unless switched off.
struct Nuisances {
  bool gain_drift = true;    // camera's gain and a dirty window: all lamps together, 12 %
  bool lamp_drift = true;    // each lamp, 6 %
  bool dimming = true;       // some lamps at half power after midnight
  bool outages = true;       // a lamp goes out for a while
  bool shake = true;         // wind: 2.5 px, and a little rotation
  bool cars = true;          // moving lights
  bool stray_lights = true;  // lamps that are in no catalogue
  bool hot_pixels = true;
};

// What comes for a part of the day, where it is asked for (events.h).
struct Events {
  bool rain_on_window = false;  // drops and streaks before the lens
  bool shadows = false;         // the sun shines on a part of each target
  bool snow = false;            // on targets and ground
};

// Which part of the clock the frames are spread over.
enum class Hours { night, day, both };

struct NightOptions {
  std::uint64_t seed = 1;
  int frames = 45;             // observations, 1..2000; the clear reference comes on top
  Hours hours = Hours::night;  // by day, and with both, dark targets stand against the horizon sky
  int lamps = 7;               // 1..40
  Style style = Style::bracket;
  Luminaire luminaire = Luminaire::even;
  double nearest_m = 60;                 // lamps are spread evenly in ln(distance) from nearest ...
  double farthest_m = 1200;              // ... to farthest
  std::vector<double> distances_m{};     // if not empty: these instead of `lamps`, `nearest_m`, `farthest_m`
  std::vector<std::string> catalogue{};  // ids that the site file lists; empty: all
  std::vector<double> targets_m{150, 450, 1350, 4000};  // distances of the day's targets; 1 to 8
  double mor_min_m = 40;                                // weather stays within these
  double mor_max_m = 25000;
  int nights = 1;        // the frames are spread over so many; more than one by night only
  int clear_nights = 0;  // the first so many of them have nothing below 12 km
  double ageing = 0;     // part of their light that all lamps have lost by the last frame, little by little
  double dirt = 0;       // part of all light that the window has lost by then
  Nuisances nuisances{};
  Events events{};
};

struct Lamp {
  std::string id{};
  double x_px = 0, y_px = 0;  // in the picture of a camera at rest
  double distance_m = 0;
  double intensity = 1;  // towards the camera, 1 is the usual lamp's
  double height_m = 8;   // above the ground (cut-off luminaires)
  bool cutoff = false;   // its luminaire
  bool in_catalogue = true;
  int lit_from_frame = 0;  // a stray light may be switched on during the night
};

// Head lamps on a road; where they are at the middle of the frame's exposures, and how fast.
struct Car {
  double x_px = 0, y_px = 0;
  double distance_m = 0;
  double intensity = 1;  // of each of its two lamps
  double spacing_px = 8;
  double speed_px_per_s = 0;
};

struct SunAngles {
  double altitude_deg = -90;
  double azimuth_deg = 0;
};

// A dark object on the skyline: tree line, building, hill.
struct SkylineTarget {
  std::string id{};
  int x_px = 0, y_px = 0, width_px = 0, height_px = 0;
  double distance_m = 0;
  double reflectance = 0.06;
};

// The sun on a target whose other part lies in shadow.
struct Sunlight {
  double edge = 0;        // of the target's width from its left side; the sun shines left of it
  double brightness = 1;  // there, against the shadow
};

// What daylight does in one frame.
struct Daylight {
  SunAngles sun;
  double horizon_electrons_per_s = 0;  // of the horizon sky, a pixel's, mid-picture
  std::vector<double>
      path_extinction;  // of each target, and of the ground (last): its share of the station's
  std::vector<double> target_brightness;  // of each target, and of the ground: wet, lit, shaded; 1 is usual
  double airlight = 1;                    // of the paths, against the horizon sky
  std::vector<Sunlight> sunlight;         // of each target; empty: as target_brightness says
  std::vector<double> snow;  // reflectance of each target, and of the ground, under snow; or empty
};

struct Frame {
  TimePoint time_utc{};
  FrameRole role = FrameRole::observation;
  double extinction_per_m = 0;
  double q = 0;
  Weather weather = Weather::clear;
  double gain = 1;                    // common to all light; 1 in the clear reference
  std::vector<double> lamp_strength;  // of each lamp, 1 is its usual; 0 is out
  double shift_x_px = 0, shift_y_px = 0, rotation_rad = 0;
  double sky_electrons_per_s = 0;  // a pixel's, at the picture's middle
  std::vector<Car> cars;
  Daylight day;
  std::vector<Drop> drops;  // on the window

  double mor_m() const { return kMorTimesExtinction / extinction_per_m; }
};

struct Night {
  NightOptions options;
  int references = 0;                  // frames[0] … frames[references-1] are clear references
  std::vector<SkylineTarget> targets;  // none by night alone
  std::vector<Lamp> lamps;             // catalogue lamps and stray lights
  std::vector<Frame> frames;           // clear reference first, oldest first
  int stray_from = 0;                  // lamps[stray_from...] were never meant to be in a catalogue
};

// Everything about a night follows from its options; the same options give the same night.
Night plan_night(const NightOptions& options);

// Two clear brackets come before the first observation; two by night and two by day where both are asked for.
inline constexpr int kReferenceFrames = 2;

inline constexpr double kLatitude_deg = 52.1;
inline constexpr double kLongitude_deg = 5.18;
inline constexpr double kCameraAzimuth_deg = 20;  // away from the sun
inline constexpr double kCameraHeight_m = 4;      // above the ground that the lamps stand on
inline constexpr double kHorizonRow = 300;
inline constexpr int kWidthPx = 760;
inline constexpr int kHeightPx = 504;
inline constexpr double kFocalLengthPx = 1044;

}  // namespace lampglow::simulation
