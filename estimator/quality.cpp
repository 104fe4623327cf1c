#include "estimator/quality.h"

#include <array>

namespace lampglow {
namespace {

constexpr std::array kRegistry{
    QualityFlag{Quality::frame_missing, "frame_missing",
                "The image file was not there or the camera gave none."},
    QualityFlag{Quality::frame_truncated, "frame_truncated", "The image ended before its last row."},
    QualityFlag{Quality::frame_wrong_size, "frame_wrong_size",
                "Width or height differ from the site's camera."},
    QualityFlag{Quality::frame_wrong_depth, "frame_wrong_depth",
                "Bit depth or channels differ from the site's camera."},
    QualityFlag{Quality::frame_undecodable, "frame_undecodable", "The file is no image that can be decoded."},
    QualityFlag{Quality::frame_too_large, "frame_too_large",
                "The image claims more pixels than the camera has; it was not decoded."},
    QualityFlag{Quality::frame_blank, "frame_blank", "The picture is of one grey: no information in it."},
    QualityFlag{Quality::frame_frozen, "frame_frozen",
                "The picture is the same as the one before it, to the last bit."},
    QualityFlag{Quality::daylight, "daylight", "Too bright for lamps; the glow method was not used."},
    QualityFlag{Quality::twilight, "twilight",
                "The sun is between the day's and the night's altitude; both methods are weak."},
    QualityFlag{Quality::no_reference, "no_reference", "No clear reference is known for this camera."},
    QualityFlag{Quality::no_lights, "no_lights", "No lamp is in the site's catalogue."},
    QualityFlag{Quality::unknown_distance, "unknown_distance",
                "No lamp or target has a known or calibrated distance."},
    QualityFlag{Quality::no_angular_scale, "no_angular_scale",
                "The focal length is not known; the glow's shape was not used."},
    QualityFlag{Quality::automatic_exposure, "automatic_exposure",
                "Exposure or gain of this frame are not known."},
    QualityFlag{Quality::saturated, "saturated",
                "Lamp cores are saturated in every exposure; only their halos were used."},
    QualityFlag{Quality::not_registered, "not_registered",
                "The frame could not be registered to the reference."},
    QualityFlag{
        Quality::camera_moved, "camera_moved",
        "The picture is displaced by more than 7.5 px against the reference, more than wind shakes it."},
    QualityFlag{Quality::few_lights, "few_lights", "Fewer lamps were used than half of the catalogue's."},
    QualityFlag{Quality::lights_missing, "lights_missing",
                "Lamps that should be seen in this weather are off or hidden."},
    QualityFlag{Quality::stray_lights, "stray_lights", "Lights were seen that are in no catalogue."},
    QualityFlag{Quality::gain_drift, "gain_drift",
                "Camera gain or window transmission differ markedly from the reference."},
    QualityFlag{Quality::fit_not_converged, "fit_not_converged", "The fit did not converge."},
    QualityFlag{Quality::poor_fit, "poor_fit",
                "The residuals are larger than the noise explains; the bounds were widened."},
    QualityFlag{Quality::at_bound, "at_bound", "A fitted parameter ended at its bound."},
    QualityFlag{Quality::q_unknown, "q_unknown", "The data do not determine q."},
    QualityFlag{Quality::limit_above, "limit_above",
                "Visibility is beyond what the lamps resolve; mor_m is a lower limit."},
    QualityFlag{Quality::limit_below, "limit_below",
                "Fog is too thick for the lamps; mor_m is an upper limit."},
    QualityFlag{Quality::no_lamp_visible, "no_lamp_visible", "No lamp of the catalogue was seen."},
    QualityFlag{
        Quality::moving_lights, "moving_lights",
        "Lights were seen that are not in the reference (cars, lamps newly lit); the fit allowed for them."},
    QualityFlag{Quality::calibrated_distance, "calibrated_distance",
                "Distances are effective ones, learned by calibrate."},
    QualityFlag{Quality::no_targets, "no_targets", "No day target is in the site's catalogue."},
    QualityFlag{Quality::sun_in_picture, "sun_in_picture", "The sun is in the picture or close to it."},
    QualityFlag{Quality::low_sun, "low_sun",
                "Low sun lights the targets; their intrinsic brightness is uncertain."},
    QualityFlag{
        Quality::shadows, "shadows",
        "The light on the targets is not that of the clear reference: shadows, bright patches, or no sun."},
    QualityFlag{Quality::snow, "snow", "Targets are brighter than dark targets are: snow or frost."},
    QualityFlag{Quality::rain_on_window, "rain_on_window",
                "Parts of the targets are veiled or blurred and others not: drops on the window."},
    QualityFlag{Quality::night_mode, "night_mode",
                "The camera is in night mode (monochrome, automatic gain)."},
    QualityFlag{Quality::clock_unsynchronised, "clock_unsynchronised",
                "The station's clock was not synchronised."},
    QualityFlag{Quality::camera_not_locked, "camera_not_locked",
                "The camera would not hold exposure, gain or white balance."},
    QualityFlag{Quality::internal_error, "internal_error",
                "The estimator failed on this frame; see the log."},
};

}  // namespace

std::span<const QualityFlag> quality_registry() {
  return kRegistry;
}

std::string QualityFlags::to_string() const {
  std::string text;
  for (const QualityFlag& entry : kRegistry) {
    if (!has(entry.flag)) continue;
    if (!text.empty()) text += ';';
    text += entry.name;
  }
  return text;
}

}  // namespace lampglow
