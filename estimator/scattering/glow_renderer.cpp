#include "estimator/scattering/glow_renderer.h"

#include <fftw3.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <string>

namespace lampglow::scattering {
namespace {

constexpr int kTile = 1024;        // of the inner part's transform
constexpr double kInnerFull = 32;  // px: up to here the kernel is all inner,
constexpr double kInnerEnd = 128;  // from here all outer
constexpr int kMargin = 128;       // = kInnerEnd
constexpr int kValid = kTile - 2 * kMargin;
constexpr int kCoarse = 4;  // px per pixel of the coarse picture

// A real picture and its transform in one buffer, as FFTW's in-place transforms want it.
class Plane {
 public:
  Plane(int width, int height)
      : width_(width),
        height_(height),
        stride_(2 * (width / 2 + 1)),
        data_(fftw_alloc_real(static_cast<std::size_t>(stride_) * static_cast<std::size_t>(height)),
              &fftw_free),
        forward_(fftw_plan_dft_r2c_2d(height, width, data_.get(),
                                      reinterpret_cast<fftw_complex*>(data_.get()), FFTW_ESTIMATE),
                 &fftw_destroy_plan),
        backward_(fftw_plan_dft_c2r_2d(height, width, reinterpret_cast<fftw_complex*>(data_.get()),
                                       data_.get(), FFTW_ESTIMATE),
                  &fftw_destroy_plan) {
    clear();
  }

  void clear() { std::fill_n(data_.get(), size(), 0.0); }
  double& at(int column, int row) { return data_.get()[static_cast<std::ptrdiff_t>(row) * stride_ + column]; }
  double* row(int index) { return data_.get() + static_cast<std::ptrdiff_t>(index) * stride_; }
  int width() const { return width_; }
  int height() const { return height_; }
  void forward() { fftw_execute(forward_.get()); }
  void backward() { fftw_execute(backward_.get()); }

  // Multiplies the transforms, with the scale that FFTW leaves to the caller.
  void multiply(const Plane& other) {
    const double scale = 1.0 / (static_cast<double>(width_) * static_cast<double>(height_));
    double* a = data_.get();
    const double* b = other.data_.get();
    for (std::size_t i = 0; i < size(); i += 2) {
      const double re = (a[i] * b[i] - a[i + 1] * b[i + 1]) * scale;
      a[i + 1] = (a[i] * b[i + 1] + a[i + 1] * b[i]) * scale;
      a[i] = re;
    }
  }

 private:
  std::size_t size() const { return static_cast<std::size_t>(stride_) * static_cast<std::size_t>(height_); }
  using Plan = std::unique_ptr<std::remove_pointer_t<fftw_plan>, decltype(&fftw_destroy_plan)>;
  int width_, height_, stride_;
  std::unique_ptr<double, decltype(&fftw_free)> data_;
  Plan forward_, backward_;
};

// 1 within the inner part, 0 outside, smooth between (its first and second derivatives too).
double inner_share(double offset_px) {
  const double x = std::clamp((offset_px - kInnerFull) / (kInnerEnd - kInnerFull), 0.0, 1.0);
  return 1 - x * x * x * (10 + x * (6 * x - 15));
}

// The next size whose only prime factors are 2, 3 and 5.
int fast_size(int n) {
  for (;; ++n) {
    int rest = n;
    for (const int prime : {2, 3, 5})
      while (rest % prime == 0) rest /= prime;
    if (rest == 1) return n;
  }
}

struct Layout {
  int width, height, tiles_x, tiles_y, coarse_width, coarse_height, padded_width, padded_height;

  Layout(int w, int h)
      : width(w),
        height(h),
        tiles_x((w + kValid - 1) / kValid),
        tiles_y((h + kValid - 1) / kValid),
        coarse_width(w / kCoarse + 3),
        coarse_height(h / kCoarse + 3),
        padded_width(fast_size(2 * coarse_width)),
        padded_height(fast_size(2 * coarse_height)) {}
  std::size_t tiles() const { return static_cast<std::size_t>(tiles_x) * static_cast<std::size_t>(tiles_y); }
};

// Kernel values at all offsets of a periodic plane; each value of the first quadrant serves four.
template <typename Value>
void fill_kernel(Plane& plane, int reach_x, int reach_y, Value&& value) {
  plane.clear();
  for (int y = 0; y <= reach_y; ++y)
    for (int x = 0; x <= reach_x; ++x) {
      const double v = value(x, y);
      for (const int row : {y, (plane.height() - y) % plane.height()})
        for (const int column : {x, (plane.width() - x) % plane.width()}) plane.at(column, row) = v;
    }
  plane.forward();
}

// Where a fine pixel lies on the coarse grid: between cell and cell+1.
struct CoarsePosition {
  int cell;
  double fraction;
};

CoarsePosition on_coarse(int pixel) {
  const int eighths = 2 * pixel + 1 + kCoarse;  // of a coarse pixel
  return {eighths / (2 * kCoarse), eighths % (2 * kCoarse) / (2.0 * kCoarse)};
}

class Renderer {
 public:
  Renderer(int width, int height)
      : layout_(width, height),
        tile_(kTile, kTile),
        inner_(kTile, kTile),
        coarse_(layout_.padded_width, layout_.padded_height),
        outer_(layout_.padded_width, layout_.padded_height) {}

  const Layout& layout() const { return layout_; }

  void set_kernel(const GlowKernel& kernel) {
    fill_kernel(inner_, kMargin - 1, kMargin - 1, [&](int x, int y) {
      const double offset = std::hypot(x, y);
      return offset < kInnerEnd ? inner_share(offset) * kernel.pixel(x, y) : 0.0;
    });
    // Far out the kernel is smooth: a quarter of a coarse pixel is fine enough to interpolate between (2e-4
    // at worst).
    const double reach = std::hypot(layout_.coarse_width, layout_.coarse_height);
    std::vector<double> radial(static_cast<std::size_t>(4 * reach) + 3);
    for (std::size_t i = 0; i < radial.size(); ++i) {
      const double offset = static_cast<double>(i) / 4 * kCoarse;
      radial[i] = offset > kInnerFull ? (1 - inner_share(offset)) * kernel.at(offset) : 0;
    }
    fill_kernel(outer_, layout_.coarse_width, layout_.coarse_height, [&](int x, int y) {
      const double position = 4 * std::sqrt(static_cast<double>(x * x + y * y));
      const auto i = static_cast<std::size_t>(position);
      return radial[i] + (position - static_cast<double>(i)) * (radial[i + 1] - radial[i]);
    });
  }

  // out += glow of the light in `source`.
  template <typename Tick>
  void add(std::span<const float> source, std::span<float> out, Tick&& tick) {
    for (int ty = 0; ty < layout_.tiles_y; ++ty)
      for (int tx = 0; tx < layout_.tiles_x; ++tx) {
        add_tile(source, out, tx * kValid, ty * kValid);
        tick();
      }
    add_coarse(source, out);
    tick();
  }

  void transforms_only() {
    inner_.forward();
    outer_.forward();
    for (std::size_t i = 0; i < layout_.tiles(); ++i) {
      tile_.forward();
      tile_.backward();
    }
    coarse_.forward();
    coarse_.backward();
  }

 private:
  void add_tile(std::span<const float> source, std::span<float> out, int x0, int y0) {
    for (int y = 0; y < kTile; ++y) {
      double* row = tile_.row(y);
      const int from_y = y0 + y - kMargin;
      const int begin = std::max(0, kMargin - x0), end = std::min(kTile, layout_.width - x0 + kMargin);
      std::fill(row, row + kTile, 0.0);
      if (from_y < 0 || from_y >= layout_.height) continue;
      const float* from = &source[static_cast<std::size_t>(from_y) * static_cast<std::size_t>(layout_.width)];
      for (int x = begin; x < end; ++x) row[x] = static_cast<double>(from[x0 + x - kMargin]);
    }
    tile_.forward();
    tile_.multiply(inner_);
    tile_.backward();
    for (int y = 0; y < std::min(kValid, layout_.height - y0); ++y) {
      const double* row = tile_.row(y + kMargin);
      float* to = &out[static_cast<std::size_t>(y0 + y) * static_cast<std::size_t>(layout_.width)];
      for (int x = 0; x < std::min(kValid, layout_.width - x0); ++x)
        to[x0 + x] += static_cast<float>(row[x + kMargin]);
    }
  }

  // Light is shared out among the four nearest coarse pixels, which keeps its centre of gravity; the smooth
  // result is read back the same way.
  void add_coarse(std::span<const float> source, std::span<float> out) {
    coarse_.clear();
    gather(source);
    coarse_.forward();
    coarse_.multiply(outer_);
    coarse_.backward();
    spread(out);
  }

  // First down the columns at full width, then along the row: most of the work is plain sums.
  void gather(std::span<const float> source) {
    const auto width = static_cast<std::size_t>(layout_.width);
    std::vector<double> upper(width), lower(width);
    int cell = 0;
    const auto flush = [&] {
      double* row = coarse_.row(cell);
      for (int x = 0; x < layout_.width; ++x) {
        const CoarsePosition u = on_coarse(x);
        const double value = upper[static_cast<std::size_t>(x)];
        row[u.cell] += value * (1 - u.fraction);
        row[u.cell + 1] += value * u.fraction;
      }
      std::swap(upper, lower);
      std::fill(lower.begin(), lower.end(), 0.0);
      ++cell;
    };
    for (int y = 0; y < layout_.height; ++y) {
      const CoarsePosition v = on_coarse(y);
      while (cell < v.cell) flush();
      const float* from = &source[static_cast<std::size_t>(y) * width];
      double *to_upper = upper.data(), *to_lower = lower.data();
      for (std::size_t x = 0; x < width; ++x) {
        const double value = static_cast<double>(from[x]), down = value * v.fraction;
        to_upper[x] += value - down;
        to_lower[x] += down;
      }
    }
    flush();
    flush();
  }

  void spread(std::span<float> out) {
    const auto width = static_cast<std::size_t>(layout_.width);
    std::vector<float> upper(width), lower(width);
    const auto read = [&](int cell, std::vector<float>& to) {
      const double* row = coarse_.row(cell);
      for (int x = 0; x < layout_.width; ++x) {
        const CoarsePosition u = on_coarse(x);
        to[static_cast<std::size_t>(x)] =
            static_cast<float>(row[u.cell] + u.fraction * (row[u.cell + 1] - row[u.cell]));
      }
    };
    int cell = -1;
    for (int y = 0; y < layout_.height; ++y) {
      const CoarsePosition v = on_coarse(y);
      if (v.cell != cell) {
        cell = v.cell;
        read(cell, upper);
        read(cell + 1, lower);
      }
      const auto down = static_cast<float>(v.fraction);
      float* to = &out[static_cast<std::size_t>(y) * width];
      const float *a = upper.data(), *b = lower.data();
      for (std::size_t x = 0; x < width; ++x) to[x] += a[x] + down * (b[x] - a[x]);
    }
  }

  Layout layout_;
  Plane tile_, inner_, coarse_, outer_;
};

// Distances that stand for the picture's, even in ln R; one if all is equally far.
std::vector<double> layer_distances(std::span<const float> depth_m, double distance_m, int layers) {
  if (depth_m.empty()) return {distance_m};
  const auto [low, high] = std::minmax_element(depth_m.begin(), depth_m.end());
  if (!(*low > 0)) throw std::invalid_argument("render: depths must be positive");
  if (layers < 2 || *high / *low < 1.0001f)
    return {std::sqrt(static_cast<double>(*low) * static_cast<double>(*high))};
  std::vector<double> result;
  result.reserve(static_cast<std::size_t>(layers));
  for (int i = 0; i < layers; ++i)
    result.push_back(static_cast<double>(*low) *
                     std::pow(static_cast<double>(*high) / static_cast<double>(*low), i / (layers - 1.0)));
  return result;
}

// The part of the light that belongs to a layer: distances between two layers count for both.
std::vector<float> light_of_layer(std::span<const float> clear, std::span<const float> depth_m,
                                  const std::vector<double>& distances, std::size_t layer) {
  const double step = std::log(distances[1] / distances[0]);
  std::vector<float> light(clear.size());
  for (std::size_t i = 0; i < clear.size(); ++i) {
    const double position = std::log(static_cast<double>(depth_m[i]) / distances[0]) / step;
    light[i] =
        clear[i] * static_cast<float>(std::max(0.0, 1 - std::abs(position - static_cast<double>(layer))));
  }
  return light;
}

void check(std::span<const float> clear, int width, int height, std::span<const float> depth_m,
           const RenderOptions& options, std::span<float> out) {
  check(options.medium);
  const auto size =
      static_cast<std::size_t>(std::max(width, 0)) * static_cast<std::size_t>(std::max(height, 0));
  if (size == 0 || clear.size() != size || out.size() != size || (!depth_m.empty() && depth_m.size() != size))
    throw std::invalid_argument("render: pictures and depth map must have width*height pixels");
  if (!(options.focal_length_px > 0)) throw std::invalid_argument("render: focal_length_px must be positive");
  if (options.depth_layers < 1) throw std::invalid_argument("render: depth_layers must be at least 1");
}

}  // namespace

void render_glow(std::span<const float> clear, int width, int height, std::span<const float> depth_m,
                 double distance_m, const RenderOptions& options, std::span<float> out,
                 const std::function<void(std::size_t, std::size_t)>& progress) {
  check(clear, width, height, depth_m, options, out);
  const std::vector<double> distances = layer_distances(depth_m, distance_m, options.depth_layers);
  for (const double distance : distances) GlowKernel(options, distance);  // refuses before any work is done
  const auto airlight = static_cast<float>(options.airlight);
  auto transmission = static_cast<float>(std::exp(-options.medium.extinction_per_m * distance_m));
  for (std::size_t i = 0; i < clear.size(); ++i) {
    if (!depth_m.empty())
      transmission = std::exp(-static_cast<float>(options.medium.extinction_per_m) * depth_m[i]);
    out[i] = clear[i] * transmission + airlight * (1 - transmission);
  }
  Renderer renderer(width, height);
  const std::size_t total = distances.size() * (renderer.layout().tiles() + 1);
  std::size_t done = 0;
  const auto tick = [&] {
    if (progress) progress(++done, total);
  };
  for (std::size_t layer = 0; layer < distances.size(); ++layer) {
    renderer.set_kernel(GlowKernel(options, distances[layer]));
    if (distances.size() == 1)
      renderer.add(clear, out, tick);
    else
      renderer.add(light_of_layer(clear, depth_m, distances, layer), out, tick);
  }
}

void bare_transforms(int width, int height) {
  Renderer(width, height).transforms_only();
}

}  // namespace lampglow::scattering
