#include "estimator/scattering/transfer_solution.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <stdexcept>
#include <string>

#include "estimator/scattering/quadrature.h"

namespace lampglow::scattering {
namespace {

using Complex = std::complex<double>;
constexpr double kPi = std::numbers::pi;

// The logarithmic grid of k; that of r is its mirror image, r = 1/k.
constexpr std::size_t kGrid = 2048;
constexpr double kStep = 0.025;
constexpr double kFirstLogK = -23.0;
// The part of the r grid that is kept. Below it r φ_l is constant to 1e-4; beyond it e^-T leaves nothing.
constexpr double kSmallestRadius = 3e-5, kLargestRadius = 150;
// The power of k taken out before the transform, so that both ends fade: k² φ_l goes as k^l..k^(l+2) at the
// lower end and to a constant at the upper.
constexpr double kBias = 0.5;
constexpr double kSeriesTolerance = 1e-11;
constexpr std::size_t kStreamingStart = 3000;

double k_of(std::size_t i) {
  return std::exp(kFirstLogK + kStep * static_cast<double>(i));
}

// In place, radix 2. Written out rather than taken from FFTW because the table must be the same bit for bit,
// and FFTW's choice of code depends on the processor.
void fourier_transform(std::vector<Complex>& x, bool inverse) {
  const std::size_t n = x.size();
  for (std::size_t i = 1, j = 0; i < n; ++i) {
    std::size_t bit = n >> 1;
    for (; j & bit; bit >>= 1) j ^= bit;
    j ^= bit;
    if (i < j) std::swap(x[i], x[j]);
  }
  for (std::size_t length = 2; length <= n; length <<= 1) {
    const std::size_t half = length / 2;
    std::vector<Complex> turn(half);
    for (std::size_t i = 0; i < half; ++i)
      turn[i] =
          std::polar(1.0, (inverse ? 2 : -2) * kPi * static_cast<double>(i) / static_cast<double>(length));
    for (std::size_t start = 0; start < n; start += length)
      for (std::size_t i = 0; i < half; ++i) {
        const Complex a = x[start + i], b = x[start + i + half];
        const Complex turned{b.real() * turn[i].real() - b.imag() * turn[i].imag(),
                             b.real() * turn[i].imag() + b.imag() * turn[i].real()};
        x[start + i] = a + turned;
        x[start + i + half] = a - turned;
      }
  }
}

// ln Γ(z), Re z > 0: Stirling's series after shifting z upward.
Complex log_gamma(Complex z) {
  Complex shift = 0;
  while (z.real() < 12) {
    shift += std::log(z);
    z += 1.0;
  }
  const Complex inverse = 1.0 / z, square = inverse * inverse;
  const Complex series =
      inverse * (1.0 / 12 - square * (1.0 / 360 - square * (1.0 / 1260 - square * (1.0 / 1680))));
  return (z - 0.5) * std::log(z) - z + 0.5 * std::log(2 * kPi) + series - shift;
}

// Mellin transform ∫ x^(s-1) j_l(x) dx = √π 2^(s-2) Γ((l+s)/2) / Γ((3+l-s)/2), 0 < Re s < 2.
Complex bessel_mellin(double l, Complex s) {
  return std::sqrt(kPi) *
         std::exp((s - 2.0) * std::log(2.0) + log_gamma((l + s) / 2.0) - log_gamma((3.0 + l - s) / 2.0));
}

double frequency(std::size_t m) {
  const double turns =
      m < kGrid / 2 ? static_cast<double>(m) : static_cast<double>(m) - static_cast<double>(kGrid);
  return 2 * kPi * turns / (kStep * static_cast<double>(kGrid));
}

// Continued fraction of free streaming, D_l = (2l+1) + k²(l+1)²/D_(l+1), from far above by its asymptotic
// form.
double streaming_fraction(double k, std::size_t order) {
  const double x = 1 + std::hypot(1.0, k);
  const double ratio = k / x * k;  // k²/x without overflow
  const double c = (1 + ratio) / (1 + ratio / x);
  double fraction = x * static_cast<double>(order + kStreamingStart) + c;
  for (std::size_t l = order + kStreamingStart; l-- > order;) {
    const double up = k * static_cast<double>(l + 1);
    fraction = static_cast<double>(2 * l + 1) + up * (up / fraction);
  }
  return fraction;
}

}  // namespace

struct TransferKernel::Data {
  double q = 0;
  std::size_t orders = 0;
  std::vector<double> streaming;  // D_L(k), L = orders
  std::vector<double> direct;     // φ⁰_l(k), [k][l], l < orders
};

TransferKernel::~TransferKernel() = default;
TransferKernel::TransferKernel(TransferKernel&&) noexcept = default;

TransferKernel::TransferKernel(double q) : data_(std::make_unique<Data>()) {
  if (!(q >= -0.9 && q <= 0.98))
    throw std::invalid_argument("transfer solution: q = " + std::to_string(q) +
                                ", must be within -0.9..0.98");
  Data& data = *data_;
  data.q = q;
  const double magnitude = std::max(std::abs(q), 0.05);
  data.orders = static_cast<std::size_t>(std::log(kSeriesTolerance) / std::log(magnitude)) + 4;
  const std::size_t orders = data.orders;
  data.streaming.resize(kGrid);
  data.direct.resize(kGrid * orders);
  std::vector<double> fraction(orders + 1);
  for (std::size_t i = 0; i < kGrid; ++i) {
    const double k = k_of(i);
    fraction[orders] = data.streaming[i] = streaming_fraction(k, orders);
    for (std::size_t l = orders; l-- > 0;) {
      const double up = k * static_cast<double>(l + 1);
      fraction[l] = static_cast<double>(2 * l + 1) + up * (up / fraction[l + 1]);
    }
    double* direct = &data.direct[i * orders];
    direct[0] = 1 / fraction[0];
    for (std::size_t l = 1; l < orders; ++l)
      direct[l] = k * static_cast<double>(l) / fraction[l] * direct[l - 1];
  }
}

namespace {

// k² φ_l(k) of the light scattered at least once, [l][k], by elimination from the highest order down: every
// pivot is a sum of positive terms.
std::vector<double> scattered_moments(const TransferKernel::Data& kernel, double albedo) {
  const std::size_t orders = kernel.orders;
  std::vector<double> result(orders * kGrid), pivot(orders), source(orders), scatter(orders);
  double power = albedo;
  for (std::size_t l = 0; l < orders; ++l, power *= kernel.q) scatter[l] = power;
  for (std::size_t i = 0; i < kGrid; ++i) {
    const double k = k_of(i);
    const double* direct = &kernel.direct[i * orders];
    double pivot_above = kernel.streaming[i], source_above = 0;
    for (std::size_t l = orders; l-- > 0;) {
      const double weight = static_cast<double>(2 * l + 1), up = k * static_cast<double>(l + 1);
      source[l] = weight * scatter[l] * direct[l] - up / pivot_above * source_above;
      pivot[l] = weight * (1 - scatter[l]) + up * (up / pivot_above);
      pivot_above = pivot[l];
      source_above = source[l];
    }
    double moment = source[0] / pivot[0];
    result[i] = k * moment * k;
    for (std::size_t l = 1; l < orders; ++l) {
      moment = (source[l] + k * static_cast<double>(l) * moment) / pivot[l];
      result[l * kGrid + i] = k * moment * k;
    }
  }
  return result;
}

// r φ_l(r) = 1/(2π²) ∫ g(x/r) j_l(x) dx on r_i = 1/k_i of a g that fades as k^bias h, h -> 0 at both ends.
std::vector<Complex> to_space(const double* g, double bias, const std::vector<Complex>& mellin) {
  std::vector<Complex> h(kGrid);
  for (std::size_t i = 0; i < kGrid; ++i)
    h[i] = g[i] * std::exp(-bias * (kFirstLogK + kStep * static_cast<double>(i)));
  fourier_transform(h, false);
  for (std::size_t m = 0; m < kGrid; ++m) h[m] *= mellin[m];
  h[kGrid / 2] = h[kGrid / 2].real();
  fourier_transform(h, true);
  for (std::size_t i = 0; i < kGrid; ++i)
    h[i] *= std::exp(bias * (kFirstLogK + kStep * static_cast<double>(i))) /
            (2 * kPi * kPi * static_cast<double>(kGrid));
  return h;
}

std::vector<Complex> mellin_of_order(double l, double bias) {
  std::vector<Complex> result(kGrid);
  for (std::size_t m = 0; m < kGrid; ++m) result[m] = bessel_mellin(l, Complex(1 + bias, frequency(m)));
  return result;
}

// From order l to l + 2.
void raise_order(std::vector<Complex>& mellin, double l, double bias) {
  for (std::size_t m = 0; m < kGrid; ++m) {
    const Complex s(1 + bias, frequency(m));
    mellin[m] *= (l + s) / (l + 3.0 - s);
  }
}

}  // namespace

TransferSolution::TransferSolution(const TransferKernel& kernel, double albedo)
    : orders_(kernel.data().orders) {
  if (!(albedo > 0 && albedo <= 1))
    throw std::invalid_argument("transfer solution: albedo = " + std::to_string(albedo) +
                                ", must be in (0, 1]");
  std::vector<double> moments = scattered_moments(kernel.data(), albedo);

  // Order 0 does not fade at both ends (it is the diffusion of far light, and the singularity of near): take
  // out A + (B-A) k²/(1+k²), whose transform is (A + (B-A) e^-r)/4π.
  const double far = moments[0], near = moments[kGrid - 1];
  for (std::size_t i = 0; i < kGrid; ++i) {
    const double k2 = k_of(i) * k_of(i);
    moments[i] -= far + (near - far) * (k2 / (1 + k2));
  }

  // r = 1/k runs downward; keep what lies between the smallest and largest radius, turned upward.
  const auto index_of_radius = [](double r) {
    return static_cast<std::size_t>((-std::log(r) - kFirstLogK) / kStep);
  };
  const std::size_t from = index_of_radius(kLargestRadius), to = index_of_radius(kSmallestRadius);
  const std::size_t radii = to - from + 1;
  step_ = kStep;
  first_log_radius_ = -(kFirstLogK + kStep * static_cast<double>(to));
  moments_.resize(radii * orders_);
  fluence_.resize(radii);

  std::vector<Complex> even = mellin_of_order(2, kBias), odd = mellin_of_order(1, kBias);
  double power = albedo;
  for (std::size_t l = 0; l < orders_; ++l, power *= kernel.data().q) {
    const double bias = l == 0 ? 0 : kBias;
    std::vector<Complex>& mellin = l % 2 == 0 ? even : odd;
    const std::vector<Complex> space =
        to_space(&moments[l * kGrid], bias, l == 0 ? mellin_of_order(0, 0) : mellin);
    if (l > 0) raise_order(mellin, static_cast<double>(l), bias);
    const double factor = static_cast<double>(2 * l + 1) * power / (4 * kPi);
    for (std::size_t j = 0; j < radii; ++j) {
      double value = space[to - j].real();
      if (l == 0) {
        const double radius = std::exp(first_log_radius_ + step_ * static_cast<double>(j));
        value += (far + (near - far) * std::exp(-radius)) / (4 * kPi);
        fluence_[j] = value;
      }
      moments_[j * orders_ + l] = factor * value;
    }
  }
  for (std::size_t l = 0; l < orders_; ++l) {
    recurrence_a_.push_back(static_cast<double>(2 * l + 1) / static_cast<double>(l + 1));
    recurrence_b_.push_back(static_cast<double>(l) / static_cast<double>(l + 1));
  }
}

namespace {

// Where a radius lies on the grid, and the weights of Lagrange's cubic there.
struct GridPoint {
  std::size_t index = 0;
  double weight[4] = {};
};

GridPoint locate(double position, std::size_t count) {
  const double clamped = std::clamp(position, 1.0, static_cast<double>(count) - 2.0 - 1e-9);
  const auto cell = static_cast<std::size_t>(clamped);
  const double x = clamped - static_cast<double>(cell);
  return {cell - 1,
          {-x * (x - 1) * (x - 2) / 6, (x + 1) * (x - 1) * (x - 2) / 2, -(x + 1) * x * (x - 2) / 2,
           (x + 1) * x * (x - 1) / 6}};
}

}  // namespace

double TransferSolution::source_times_radius(double radius, double cosine) const {
  const GridPoint point = locate((std::log(radius) - first_log_radius_) / step_, fluence_.size());
  const double* row = &moments_[point.index * orders_];
  double sum = 0, polynomial = 1, before = 0;
  for (std::size_t l = 0; l < orders_; ++l) {
    const double moment = point.weight[0] * row[l] + point.weight[1] * row[orders_ + l] +
                          point.weight[2] * row[2 * orders_ + l] + point.weight[3] * row[3 * orders_ + l];
    sum += moment * polynomial;
    const double next = recurrence_a_[l] * cosine * polynomial - recurrence_b_[l] * before;
    before = polynomial;
    polynomial = next;
  }
  return sum;
}

// Along the view ray X = b sinh u from the lamp's foot point, b = T sin θ: ds = r du, so r J is what is
// summed.
double TransferSolution::multiple(double thickness, double theta_rad) const {
  const auto& rule = GaussLegendre<6>::get();
  const double miss = thickness * std::sin(theta_rad), camera = thickness * std::cos(theta_rad);
  const double u_end = std::asinh(camera / miss);
  const double u_begin = std::asinh((camera - 30) / miss);  // e^-30 of the light is left
  const auto panels = static_cast<int>(std::ceil((u_end - u_begin) / 0.6));
  const double half = (u_end - u_begin) / (2 * panels);
  double sum = 0;
  for (int panel = 0; panel < panels; ++panel)
    for (std::size_t i = 0; i < rule.node.size(); ++i) {
      const double u = u_begin + half * (2 * panel + 1 + rule.node[i]);
      const double x = miss * std::sinh(u), radius = miss * std::cosh(u);
      sum += half * rule.weight[i] * source_times_radius(radius, std::tanh(u)) * std::exp(x - camera);
    }
  return sum;
}

double TransferSolution::scattered_fluence_rate(double radius) const {
  const GridPoint point = locate((std::log(radius) - first_log_radius_) / step_, fluence_.size());
  double sum = 0;
  for (std::size_t i = 0; i < 4; ++i) sum += point.weight[i] * fluence_[point.index + i];
  return sum / radius;
}

}  // namespace lampglow::scattering
