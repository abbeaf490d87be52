//! What a disc hides of a light: the inside of a conic in the light's parameters.
//!
//! With the occluder's plane `n . x = D`, its centre c and radius r relative to `p`, the segment to
//! the light's point d meets the plane at `d D / N` with `N = n . d`. The point is hidden where
//! `|D d - N c| <= r N`. Take parameters (x, y), a rotation of the light's (s, t), such that N does
//! not change with y. Then the left side's vector is `g(x) + y D E` with E in the occluder's plane,
//! and the condition reads `|y - alpha(x)| <= sqrt(q(x))` with alpha affine and q quadratic: a band
//! about a line. The light's own disc is such a band (alpha = 0, q = 1 - x²), a polygon is bounded by
//! straight lines, and the area under `sqrt(q)` is elementary. So between the abscissae at which two
//! of these curves meet, the area of the intersection is a closed form.

use glam::{DVec2, DVec3};

use super::area::{Line, Polygon};
use super::emitter::{Emitter, Shape};

/// The condition for being hidden by a disc.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hidden {
    /// Unit vectors of x and y in the light's parameters.
    x_axis: DVec2,
    y_axis: DVec2,
    band: Band,
}

/// The points with `|y - line(x)| <= sqrt(factors[0](x) factors[1](x))`, all three affine in x and
/// given as their value at 0 and their slope. Both factors are positive inside.
///
/// Factors and not their product, since q matters most near its ends, where it is small.
#[derive(Clone, Copy, Debug)]
struct Band {
    line: [f64; 2],
    factors: [[f64; 2]; 2],
}

impl Hidden {
    /// The occluder's plane is `normal . d == distance > 0`, `center` lies on it, all relative to the
    /// receiver point.
    pub(super) fn new(
        emitter: &Emitter,
        normal: DVec3,
        distance: f64,
        center: DVec3,
        radius: f64,
    ) -> Self {
        let gradient = DVec2::new(normal.dot(emitter.u), normal.dot(emitter.v));
        let x_axis = gradient.normalize_or(DVec2::X);
        let y_axis = x_axis.perp();
        let along_x = emitter.u * x_axis.x + emitter.v * x_axis.y;
        let e = emitter.u * y_axis.x + emitter.v * y_axis.y;
        // Affine in x: [at 0, slope].
        let n = [normal.dot(emitter.center), normal.dot(along_x)];
        let g = [emitter.center * distance - center * n[0], along_x * distance - center * n[1]];
        if emitter.shape == Shape::Point {
            // Only x = y = 0 is ever asked for: any band that holds it exactly if it is hidden.
            let (reach, offset) = (radius * n[0], g[0].length());
            let factors = [[reach - offset, 0.0], [reach + offset, 0.0]];
            return Self { x_axis, y_axis, band: Band { line: [0.0; 2], factors } };
        }
        // |g + y D E|² <= r² N²  <=>  (y - alpha)² <= (|E|² r² N² - |g x E|²) / (D² |E|⁴).
        let length = e.length();
        let scale = 1.0 / (distance * length * length);
        let side = g.map(|g| normal.dot(g.cross(e)) * scale);
        let reach = n.map(|n| length * radius * n * scale);
        let factors =
            [[reach[0] - side[0], reach[1] - side[1]], [reach[0] + side[0], reach[1] + side[1]]];
        let line = g.map(|g| -g.dot(e) * scale);
        Self { x_axis, y_axis, band: Band { line, factors } }
    }

    /// Whether a point of the light, beyond the occluder's plane, is hidden.
    pub(super) fn contains(&self, s: f64, t: f64) -> bool {
        let point = DVec2::new(s, t);
        let (x, y) = (point.dot(self.x_axis), point.dot(self.y_axis));
        let offset = y - self.band.middle(x);
        offset * offset <= self.band.square_at(x)
    }

    /// The hidden area of a light's shape within `region`, beyond the occluder's plane.
    pub(super) fn area(&self, region: &Polygon, shape: Shape) -> f64 {
        let rotate = |p: &DVec2| DVec2::new(p.dot(self.x_axis), p.dot(self.y_axis));
        let region = Polygon(region.0.iter().map(rotate).collect());
        match shape {
            Shape::Disc => intersection_area(region, &[self.band, Band::UNIT_DISC]),
            Shape::Square | Shape::Point => intersection_area(region, &[self.band]),
        }
    }
}

/// Area of the part of a convex polygon that lies in all bands.
fn intersection_area(mut polygon: Polygon, bands: &[Band]) -> f64 {
    for [constant, s] in bands.iter().flat_map(|band| band.factors) {
        polygon.clip(Line { s, t: 0.0, constant });
    }
    let ends = polygon.0.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(from, to), corner| {
        (from.min(corner.x), to.max(corner.x))
    });
    if ends.0 >= ends.1 {
        return 0.0;
    }
    // Count x from the left end. Where a conic is steep, next to the occluder's plane, the polynomials
    // below would lose there what they need most.
    let (from, to) = (0.0, ends.1 - ends.0);
    for corner in &mut polygon.0 {
        corner.x -= ends.0;
    }
    let bands: Vec<Band> = bands.iter().map(|band| band.counted_from(ends.0)).collect();
    let mut lower: Vec<Curve> = bands.iter().map(|&band| Curve { band, side: -1.0 }).collect();
    let mut upper: Vec<Curve> = bands.iter().map(|&band| Curve { band, side: 1.0 }).collect();
    let mut breaks: Vec<f64> = polygon.0.iter().map(|corner| corner.x).collect();
    for (a, b) in polygon.edges().filter(|(a, b)| a.x != b.x) {
        let slope = (b.y - a.y) / (b.x - a.x);
        let line = [a.y - slope * a.x, slope];
        let edge = Curve { band: Band { line, factors: [[0.0; 2]; 2] }, side: 0.0 };
        // Anticlockwise: the lower edges run to the right.
        if b.x > a.x {
            lower.push(edge)
        } else {
            upper.push(edge)
        }
        for band in &bands {
            breaks.extend(roots(&band.meets_line(line), from, to));
        }
    }
    for (i, a) in bands.iter().enumerate() {
        for b in &bands[i + 1..] {
            let crossings = a.meets(b);
            breaks.extend(roots(&crossings, from, to));
            // Bands with one middle line cross above and below it at once: a double root, which is
            // a single root of the derivative. A break too many does no harm.
            breaks.extend(roots(&derivative(&crossings), from, to));
        }
    }
    breaks.sort_by(f64::total_cmp);
    breaks
        .windows(2)
        .map(|w| {
            let (x0, x1) = (w[0], w[1]);
            let middle = 0.5 * (x0 + x1);
            let height = |curve: &&Curve| curve.at(middle);
            let by_height = |a: &&Curve, b: &&Curve| height(a).total_cmp(&height(b));
            match (upper.iter().min_by(by_height), lower.iter().max_by(by_height)) {
                (Some(top), Some(bottom)) if height(&top) > height(&bottom) => {
                    top.area_below(x0, x1) - bottom.area_below(x0, x1)
                }
                _ => 0.0,
            }
        })
        .sum::<f64>()
        .max(0.0)
}

/// One side of a band, or its middle line where `side` is 0.
struct Curve {
    band: Band,
    side: f64,
}

impl Curve {
    fn at(&self, x: f64) -> f64 {
        self.band.middle(x) + self.side * self.band.square_at(x).max(0.0).sqrt()
    }

    /// Area between the curve and y = 0 over [x0, x1].
    fn area_below(&self, x0: f64, x1: f64) -> f64 {
        let straight = (x1 - x0) * self.band.middle(0.5 * (x0 + x1));
        if self.side == 0.0 {
            return straight;
        }
        let root = |x: f64| self.band.square_at(x).max(0.0).sqrt();
        straight + self.side * area_below_root(self.band.square()[2], x1 - x0, root(x0), root(x1))
    }
}

impl Band {
    const UNIT_DISC: Self = Self { line: [0.0; 2], factors: [[1.0, 1.0], [1.0, -1.0]] };

    fn middle(&self, x: f64) -> f64 {
        self.line[0] + self.line[1] * x
    }

    /// q at x.
    fn square_at(&self, x: f64) -> f64 {
        let [a, b] = self.factors.map(|[constant, slope]| constant + slope * x);
        a * b
    }

    /// The coefficients of q, from the constant up.
    fn square(&self) -> [f64; 3] {
        let [a, b] = self.factors;
        [a[0] * b[0], a[0] * b[1] + a[1] * b[0], a[1] * b[1]]
    }

    /// The same band with x counted from `start`.
    fn counted_from(&self, start: f64) -> Self {
        let shift = |[constant, slope]: [f64; 2]| [constant + slope * start, slope];
        Self { line: shift(self.line), factors: self.factors.map(shift) }
    }

    /// The polynomial that vanishes where one of the band's sides meets a line: d² - q, with d the
    /// line above the band's middle.
    fn meets_line(&self, line: [f64; 2]) -> [f64; 3] {
        let d = [line[0] - self.line[0], line[1] - self.line[1]];
        let [q0, q1, q2] = self.square();
        [d[0] * d[0] - q0, 2.0 * d[0] * d[1] - q1, d[1] * d[1] - q2]
    }

    /// The polynomial that vanishes where a side of one band meets a side of the other: the product
    /// of d ± sqrt(q) ± sqrt(r) over all signs, (d² - q - r)² - 4 q r.
    fn meets(&self, other: &Self) -> [f64; 5] {
        let m = self.meets_line(other.line);
        let (q, r) = (self.square(), other.square());
        let a = [m[0] - r[0], m[1] - r[1], m[2] - r[2]];
        let mut out = [0.0; 5];
        for i in 0..3 {
            for j in 0..3 {
                out[i + j] += a[i] * a[j] - 4.0 * q[i] * r[j];
            }
        }
        out
    }
}

/// The integral of sqrt(q) over a length `h` for a quadratic q with leading coefficient `a`, from the
/// roots `y0` and `y1` of its end values.
///
/// The trapezium under the chord plus the segment between chord and conic. An ellipse, stretched to a
/// circle, has the half angle `delta` with `tan delta = sqrt(-a) h / (y0 + y1)` and the chord
/// `L² = (y1 - y0)² - a h²`; its segment is `L² / 4 (delta - sin delta cos delta) / sin² delta`.
/// Written with `tau = tan² delta` this holds for a parabola (tau = 0) and a hyperbola (tau < 0) too.
fn area_below_root(a: f64, h: f64, y0: f64, y1: f64) -> f64 {
    let sum = y0 + y1;
    if h <= 0.0 || (sum == 0.0 && a >= 0.0) {
        return 0.0;
    }
    let quarter_chord2 = 0.25 * ((y1 - y0) * (y1 - y0) - a * h * h);
    let tau = -a * h * h / (sum * sum);
    // (delta - sin cos) / sin² / sqrt(-a).
    let segment = if tau > 0.25 {
        let (cotangent, root) = (sum / ((-a).sqrt() * h), (-a).sqrt());
        let delta = 1.0_f64.atan2(cotangent);
        (delta * (1.0 + cotangent * cotangent) - cotangent) / root
    } else if tau < -0.25 {
        // With tan delta = i s, s in (0, 1]; (1 - s²) atanh s vanishes at s = 1.
        let s = (-tau).sqrt().min(1.0);
        let product = if s < 1.0 { (1.0 - s * s) * s.atanh() } else { 0.0 };
        (h / sum) * (s - product) / (s * s * s)
    } else {
        // ((1 + T²) atan T - T) / T³ = sum of 2 (-T²)^k / ((2k + 1) (2k + 3)): 26 terms of at most
        // 4^-k reach 2⁻⁵² and beyond.
        let series = (0..26).rev().fold(0.0, |s, k| {
            let k = f64::from(k);
            2.0 / ((2.0 * k + 1.0) * (2.0 * k + 3.0)) - tau * s
        });
        (h / sum) * series
    };
    0.5 * h * sum + quarter_chord2 * segment
}

/// The roots of odd multiplicity of a polynomial (coefficients from the constant up) in [from, to]:
/// between two neighbouring extrema there is at most one, found by bisection.
fn roots(polynomial: &[f64], from: f64, to: f64) -> Vec<f64> {
    let value = |x: f64| polynomial.iter().rev().fold(0.0, |sum, c| sum * x + c);
    if polynomial.len() < 2 {
        return Vec::new();
    }
    let mut ends = vec![from];
    ends.extend(roots(&derivative(polynomial), from, to));
    ends.push(to);
    ends.windows(2).filter_map(|w| bisect(value, w[0], w[1])).collect()
}

fn derivative(polynomial: &[f64]) -> Vec<f64> {
    polynomial.iter().enumerate().skip(1).map(|(i, c)| i as f64 * c).collect()
}

/// Where a continuous function changes sign between `a` and `b`, to the last bit.
fn bisect(value: impl Fn(f64) -> f64, mut a: f64, mut b: f64) -> Option<f64> {
    let positive = value(a) > 0.0;
    if positive == (value(b) > 0.0) {
        return None;
    }
    loop {
        let middle = 0.5 * (a + b);
        if middle <= a || middle >= b {
            return Some(middle);
        }
        if (value(middle) > 0.0) == positive { a = middle } else { b = middle }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Composite Simpson on a fine grid after x = h/2 (1 - cos t), which removes the roots' singularities.
    fn simpson(q: impl Fn(f64) -> f64, h: f64) -> f64 {
        let n = 20_000;
        let step = std::f64::consts::PI / f64::from(n);
        let f = |i: i32| {
            let t = step * f64::from(i);
            q(0.5 * h * (1.0 - t.cos())).max(0.0).sqrt() * 0.5 * h * t.sin()
        };
        let inner: f64 = (1..n).map(|i| f(i) * if i % 2 == 1 { 4.0 } else { 2.0 }).sum();
        (f(0) + inner + f(n)) * step / 3.0
    }

    #[test]
    fn the_area_below_a_root_is_the_integral_for_all_conics() {
        // (constant, slope, leading): ellipse, wide ellipse, parabola, nearly parabolas, hyperbolas.
        let cases = [
            (0.0, 2.0, -1.0),
            (0.0, 1.0, -0.5),
            (1.0, 0.3, -1.2),
            (0.5, 0.7, 0.0),
            (0.5, 0.7, 1e-9),
            (0.5, 0.7, -1e-9),
            (0.0, 1.0, 3.0),
            (0.0, 0.0, 2.0),
            (1.0, -2.0, 1.0),
            (0.3, -0.2, 40.0),
        ];
        for (c, b, a) in cases {
            let h = if a == -1.0 { 2.0 } else { 1.0 };
            let q = |x: f64| (a * x + b) * x + c;
            let exact = area_below_root(a, h, q(0.0).max(0.0).sqrt(), q(h).max(0.0).sqrt());
            let numeric = simpson(q, h);
            assert!(
                (exact - numeric).abs() < 1e-9,
                "q = {a} x² + {b} x + {c}: {exact} against {numeric}"
            );
        }
    }

    #[test]
    fn roots_of_a_quartic_are_found() {
        // (x - 1/4) (x - 1/2) (x + 1/2) (x - 3), the last outside the range.
        let found = roots(&[-0.1875, 0.8125, 0.5, -3.25, 1.0], -1.0, 1.0);
        assert_eq!(found.len(), 3, "{found:?}");
        for (x, expected) in found.iter().zip([-0.5, 0.25, 0.5]) {
            assert!((x - expected).abs() < 1e-14, "{x} instead of {expected}");
        }
    }

    #[test]
    fn a_band_that_is_the_unit_disc_agrees_with_circular_segments() {
        let mut polygon = Polygon::square();
        for (s, t, constant) in [(0.3, 1.0, 0.2), (-0.8, 0.1, 0.5), (1.0, -0.4, 0.7)] {
            polygon.clip(Line { s, t, constant });
            let (a, b) = (
                polygon.area_in_unit_disc(),
                intersection_area(polygon.clone(), &[Band::UNIT_DISC]),
            );
            assert!((a - b).abs() < 1e-13, "segments {a}, bands {b}");
        }
    }
}
