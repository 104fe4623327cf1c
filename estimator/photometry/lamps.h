// Lamps in a picture: found above a background mesh, told apart from each other, and measured to a small part
// of a pixel. The method is that of SExtractor (Bertin, Arnouts 1996), with prominence in place of its tree
// for deblending.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "estimator/photometry/image.h"
#include "estimator/photometry/radiance.h"

namespace lampglow::photometry {

// A light as it was found in one picture. Positions in pixels, centres at .5; fluxes in radiance times px².
struct DetectedLight {
  double x_px = 0;
  double y_px = 0;
  double position_sigma_px = 0;  // one standard deviation, each axis
  double flux = 0;               // over the aperture, background taken off; a lower bound if saturated
  double flux_sigma = 0;
  double peak = 0;        // highest pixel above the background
  double background = 0;  // local, per pixel
  double snr = 0;         // of the matched filter
  double fwhm_px = 0;     // of the light itself, from its windowed second moments
  double elongation = 1;  // long axis over short axis, ≥ 1
  int saturated_pixels = 0;
};

struct DetectionOptions {
  int mesh_samples = 16;       // along each side of a cell, at most; sigma is known to 1/sqrt(2)/this
  int mesh_px = 32;            // side of a background cell
  double psf_sigma_px = 1.2;   // of the matched filter
  double threshold_sigma = 6;  // on the matched filter
  double prominence_part =
      0.15;         // a second peak in a patch is a light if it rises above the saddle by this part of itself
  int binning = 1;  // 2: search the picture binned 2x2 (faster), measure on the full one
  double max_fwhm_px = 8;        // wider, unsaturated patches are lit walls, trees or sky
  double max_elongation = 2.5;   // longer ones are edges and poles
  double relative_error = 0.02;  // what the mesh's own structure may be off by, as part of the background
};

// A picture, with what is known of its noise and its pixels; null: nothing.
struct RadianceView {
  const Image<float>& radiance;
  const Image<float>* variance = nullptr;
  const Image<std::uint8_t>* mask = nullptr;
};

// Background and noise of a picture on a mesh: sigma-clipped median of each cell, median-filtered over 3x3
// cells, bilinear between the cells' middles. Masked pixels don't count.
class Background {
 public:
  Background(const RadianceView& image, int mesh_px, int samples = 16);

  // Of each pixel of a row; as many as the picture is wide. Sigma: one standard deviation of a pixel.
  void levels_of_row(int row, std::span<float> level) const;
  void sigmas_of_row(int row, std::span<float> sigma) const;

 private:
  void row_of(const Image<float>& mesh, int row, std::span<float> out) const;

  Image<float> level_, sigma_;  // a pixel a cell
  std::vector<std::int32_t> column_cell_, row_cell_;
  std::vector<float> column_part_, row_part_;
};

// All lights in the picture, brightest first. Hot and invalid pixels are left out; saturated ones count with
// what they are clipped at.
std::vector<DetectedLight> detect_lights(const RadianceImage& image, const DetectionOptions& options = {});

struct CentroidOptions {
  double window_sigma_px = 1.5;  // Gaussian window; grows with the core if that is wider or saturated
  double aperture_px = 4;        // radius for the flux; at least
  double search_px = 3;          // how far the centroid may walk from where it started
  int iterations = 20;
};

// The windowed centroid and the photometry of a light near (x_px, y_px): iterated Gaussian-weighted first
// moment (SExtractor's XWIN) above a plane fitted to the ring around it, so that a neighbour's halo does not
// pull. Position in the result; snr < 3 or position_sigma_px > search_px mean that nothing was there.
DetectedLight measure_light(const RadianceImage& image, double x_px, double y_px,
                            const CentroidOptions& options = {});

// Flux, peak, background and saturated pixels of `light` within a circle of fixed radius and place, above the
// plane fitted to the ring around it; soft edges.
void measure_flux(const RadianceImage& image, double x_px, double y_px, double aperture_px,
                  double ring_width_px, DetectedLight& light);

// Lights of several pictures of the same view, told apart.
struct SurveyedLight {
  DetectedLight light;  // medians over the frames in which it was seen, in the first frame's pixels
  int frames_seen = 0;
  double flux_rel_scatter = 0;  // over frames, robust
};
struct Survey {
  std::vector<SurveyedLight> lamps;   // in place in at least half of the frames; brightest first
  std::vector<SurveyedLight> moving;  // seen in fewer: cars, aircraft, lamps that were mostly off
  std::vector<PixelIndex> hot_pixels;
  int frames = 0;
};

// Frames are first brought over each other by their brightest common lights (shift alone). With one frame all
// lights are lamps.
Survey survey_lights(std::span<const std::vector<DetectedLight>> frames);

}  // namespace lampglow::photometry
