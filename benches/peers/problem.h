// The paper's problem for rivals in C++: misclosure (10) and Jacobian (12) of the hand controller.
//
// The loops run over poses, innermost and contiguous, so that the compiler vectorises them, sines
// and cosines included (libmvec, with -ffast-math). Residual k * poses + p is pair k in pose p; the
// Jacobian is column-major. The gains are scaled by 2048, so that a step of every parameter is of
// the size of an angle; solvers with a tolerance on the plain norm of x need that.
#pragma once

#include <cmath>
#include <cstdio>
#include <ctime>
#include <string>
#include <vector>

constexpr int CHANNELS = 9;
constexpr int PARAMETERS = 18;
constexpr double SCALE = 2048.0;
constexpr double L1 = -4.5, L2 = 3.2, L3 = 3.971, L4 = 1.5;
constexpr int PAIRS[3][2] = {{0, 1}, {1, 2}, {0, 2}};

class Problem {
 public:
  int poses = 0;
  std::vector<double> counts;  // [channel][pose], in units of SCALE

  Problem(int n, const std::vector<double>& rows) : poses(n), counts(CHANNELS * n), room(36 * n) {
    for (int p = 0; p < n; ++p)
      for (int c = 0; c < CHANNELS; ++c) counts[c * n + p] = rows[p * CHANNELS + c] / SCALE;
    const double bearings[3] = {M_PI, M_PI / 3, -M_PI / 3};
    for (int i = 0; i < 3; ++i) cosine[i] = std::cos(bearings[i]), sine[i] = std::sin(bearings[i]);
  }

  int residuals() const { return 3 * poses; }

  // f, and J where it is not null.
  void operator()(const double* x, double* f, double* jacobian) const {
    const int n = poses;
    for (int i = 0; i < 3; ++i) wrist(i, x, jacobian != nullptr);
    for (int k = 0; k < 3; ++k) {
      const int a = PAIRS[k][0], b = PAIRS[k][1];
      const double *ra = at(a, 0), *rb = at(b, 0);
      double* out = f + k * n;
      for (int p = 0; p < n; ++p) {
        const double u = ra[p] - rb[p], v = ra[n + p] - rb[n + p], w = ra[2 * n + p] - rb[2 * n + p];
        out[p] = u * u + v * v + w * w - 3 * L4 * L4;
      }
    }
    if (!jacobian) return;
    for (int k = 0; k < 3; ++k) {
      for (int c = 0; c < CHANNELS; ++c) {
        double* by_offset = jacobian + (c * 3 + k) * n;
        double* by_gain = jacobian + ((CHANNELS + c) * 3 + k) * n;
        const int arm = c / 3, a = PAIRS[k][0], b = PAIRS[k][1];
        if (arm != a && arm != b) {
          for (int p = 0; p < n; ++p) by_offset[p] = by_gain[p] = 0.0;
          continue;
        }
        const double sign = arm == a ? 2.0 : -2.0;
        const double *ra = at(a, 0), *rb = at(b, 0), *d = at(arm, 1 + c % 3), *count = &counts[c * n];
        for (int p = 0; p < n; ++p) {
          const double g = sign * ((ra[p] - rb[p]) * d[p] + (ra[n + p] - rb[n + p]) * d[n + p] +
                                   (ra[2 * n + p] - rb[2 * n + p]) * d[2 * n + p]);
          by_offset[p] = g;
          by_gain[p] = g * count[p];
        }
      }
    }
  }

 private:
  mutable std::vector<double> room;  // [arm][wrist and its three derivatives][x y z][pose]
  double cosine[3], sine[3];

  double* at(int arm, int what) const { return room.data() + (arm * 4 + what) * 3 * poses; }

  // Wrist i in the base frame, eq. (2), and its derivatives by the three joints.
  void wrist(int i, const double* x, bool derivatives) const {
    const int n = poses;
    const double c = cosine[i], s = sine[i];
    const double *o = x + 3 * i, *k = x + CHANNELS + 3 * i, *a = &counts[3 * i * n];
    double *r = at(i, 0), *d1 = at(i, 1), *d2 = at(i, 2), *d3 = at(i, 3);
    const auto put = [n](double* to, int p, double u, double v, double w) {
      to[p] = u, to[n + p] = v, to[2 * n + p] = w;
    };
#pragma GCC ivdep
    for (int p = 0; p < n; ++p) {
      const double t1 = k[0] * a[p] + o[0], t2 = t1 + k[1] * a[n + p] + o[1];
      const double t3 = k[2] * a[2 * n + p] + o[2];
      const double c1 = std::cos(t1), s1 = std::sin(t1), c2 = std::cos(t2), s2 = std::sin(t2);
      const double c3 = L3 * std::cos(t3), s3 = L3 * std::sin(t3);
      const double u2 = c2 * c3, v2 = s2 * c3, u = L2 * c1 + u2, v = L2 * s1 + v2;
      put(r, p, c * u + s * s3 + L1 * c, s * u - c * s3 + L1 * s, v);
      if (derivatives) {
        put(d1, p, -c * v, -s * v, u);
        put(d2, p, -c * v2, -s * v2, u2);
        put(d3, p, -c * c2 * s3 + s * c3, -s * c2 * s3 - c * c3, -s2 * s3);
      }
    }
  }
};

// What a rival says of a fit.
struct Answer {
  double x[PARAMETERS];
  int linearizations;
};

// The protocol: poses, start and counts on standard input; then, for every line with a number of
// seconds, the shortest time of a fit in as many repeats, its number of linearisations and its x.
template <typename Fit>
int serve(Fit fit) {
  int poses;
  if (std::scanf("%d", &poses) != 1) return 2;
  std::vector<double> start(PARAMETERS), rows(static_cast<size_t>(poses) * CHANNELS);
  for (double& v : start)
    if (std::scanf("%lf", &v) != 1) return 2;
  for (double& v : rows)
    if (std::scanf("%lf", &v) != 1) return 2;
  for (int c = CHANNELS; c < PARAMETERS; ++c) start[c] *= SCALE;
  const auto now = [] {
    timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
  };
  double seconds;
  while (std::scanf("%lf", &seconds) == 1) {
    double best = 1e9;
    Answer answer;
    const double end = now() + seconds;
    do {
      const double before = now();
      answer = fit(poses, rows, start);
      best = std::fmin(best, now() - before);
    } while (now() < end);
    std::printf("%.9e %d", best, answer.linearizations);
    for (int c = 0; c < PARAMETERS; ++c)
      std::printf(" %.17g", answer.x[c] / (c < CHANNELS ? 1.0 : SCALE));
    std::printf("\n");
    std::fflush(stdout);
  }
  return 0;
}
