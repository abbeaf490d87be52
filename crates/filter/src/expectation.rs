//! What theory says of filtered bounds on each hard case.

mod compared;

use antumbra_gpu::Expectation;
use antumbra_map::{Estimator, MapConfig};

pub(crate) use self::compared::{compared, joined};
use crate::prefilter::Prefilter;

/// How far a lookup's kernel reaches, and the largest root mean square of its texels' distances, an axis, texels: of a kernel
/// that no pixel's footprint widens, and of the widest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Kernel {
    pub(crate) reach: f64,
    pub(crate) spread: f64,
    pub(crate) widest: f64,
}

impl From<&Prefilter> for Kernel {
    fn from(filter: &Prefilter) -> Self {
        Self { reach: filter.reach(), spread: filter.spread(), widest: filter.widest_spread() }
    }
}

/// A bound and the settings on which its leak depends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Bound {
    Variance { deviation: f64 },
    Exponential { sharpness: f64 },
    Warps { positive: f64, deviation: f64 },
    Moments { bias: f64 },
    Layers { count: u32, deviation: f64 },
}

impl Bound {
    /// Bound on the light of a receiver a share `gap` of the depth range behind the nearest of its casters, all
    /// of one surface whose depth has the standard deviation `spread` within the kernel.
    fn leak(self, gap: f64, spread: f64) -> f64 {
        match self {
            Self::Variance { deviation } => (deviation.powi(2) + spread.powi(2)) / gap.powi(2),
            // A kernel spans no more than 3 deviations on either side.
            Self::Exponential { sharpness } => (-sharpness * (gap - 3.0 * spread)).exp(),
            Self::Warps { positive: c, deviation } => {
                let two_layers = (2.0 * (2.0 * c * (gap - 3.0 * spread)).exp() - 1.0).powi(-2);
                (2.0 * c * deviation).powi(2) + two_layers
            }
            // What is mixed in has a variance below 1, on a range of 2.
            Self::Moments { bias } => bias / gap.powi(2),
            // At worst all in one layer, which cannot hold more than its thickness.
            Self::Layers { count, deviation } => {
                let layers = f64::from(count);
                let gap = (gap * layers - 1.0).clamp(gap, 1.0);
                let spread = if gap < 1.0 { spread * layers } else { 0.0 };
                (deviation.powi(2) + spread.powi(2)) / gap.powi(2)
            }
        }
    }
}

impl Bound {
    /// Whether a receiver so small a share `gap` of the range behind its one caster, which is level, is more dark than lit:
    /// v / (v + gap²) with the variance that is there at least, or what stands for it.
    fn hides(self, gap: f64) -> bool {
        match self {
            Self::Variance { deviation } | Self::Warps { deviation, .. } => deviation < gap,
            Self::Layers { count, deviation } => deviation < f64::from(count) * gap,
            Self::Exponential { sharpness } => sharpness * gap > std::f64::consts::LN_2,
            // What is mixed in has the variance 3/8 about the middle of a range of 2.
            Self::Moments { bias } => 0.375 * bias < (2.0 * gap).powi(2),
        }
    }
}

/// A visibility that is off by as much counts as wrong (`antumbra_measure::stability`).
pub(crate) const WRONG: f64 = 1e-5;

pub(crate) fn expectation(
    map: &MapConfig,
    kernel: impl Into<Kernel>,
    bound: Bound,
    case: &str,
) -> Option<Expectation> {
    let kernel = kernel.into();
    let radius = kernel.reach;
    let estimator = Estimator { radius: radius as f32, ..Estimator::nearest() };
    let exact = antumbra_map::expectation(map, &estimator, case)?;
    let size = f64::from(map.size);
    // As in `antumbra_map`: the guard band makes texels larger than ideal ones.
    let texel = size / (size - 2.0 * (radius.ceil() + 1.0)).max(1.0);
    Some(match case {
        "HC-02 in view" if matches!(bound, Bound::Layers { .. }) => Expectation::KnownLimit {
            at_least: f64::MIN_POSITIVE,
            at_most: size,
            because: "where a floor enters a layer, its shadow gets up to 1 % of the light",
        },
        // The wire's axis is 5 cm above its receiver, which the cone moves by 2 texels of 16 cm or, of a map of 1024,
        // 2 cm for each texel of the kernel's spread.
        "HC-31 wire below a texel" => {
            let Expectation::KnownLimit { at_least, .. } = exact else { return Some(exact) };
            Expectation::KnownLimit {
                at_least,
                at_most: 1.0,
                because: "a caster thinner than a texel is in the map only where a texel's centre falls on it, and \
                          one so near its receiver is within the bias",
            }
        }
        // One sample of a floor behind the one caster, that is, as far behind it as the range is long; of 64 before and 64
        // after that it is the only one in shadow, and all of its light counts.
        "K9 nothing in view" if bound.leak(1.0, 0.0) >= f64::from(f32::MIN_POSITIVE) => {
            Expectation::KnownLimit {
                at_least: 1.0 / 128.0,
                at_most: 1.0 / 128.0,
                because: FAR_BEHIND,
            }
        }
        // So with all that is deep in shadow, one by one.
        "HC-22 T-junction" if bound.leak(1.0, 0.0) >= f64::from(f32::MIN_POSITIVE) => {
            Expectation::KnownLimit { at_least: 1.0, at_most: 1.0, because: FAR_BEHIND }
        }
        // Half of the samples are 5 cm behind a plate, of a range of 1000 m.
        "HC-13 depth precision, near caster" if !bound.hides(5e-5) => Expectation::KnownLimit {
            at_least: 0.5,
            at_most: 0.5,
            because: "so small a share of the range behind a caster a bound leaks nearly all",
        },
        "HC-09 boxes in each other" => crossing(kernel, bound, size),
        // As HC-01 C, and seen are 192 texels a side.
        "HC-25 caster out of sight" => {
            let of = |spread| slanting(exact, bound, (spread, texel), size, 192.0);
            let (least, most) = (of(kernel.spread), of(kernel.widest));
            // A camera sees it, so that kernels are anything between the two: where they part nothing is known.
            if std::mem::discriminant(&least) != std::mem::discriminant(&most) {
                return None;
            }
            least
        }
        // No less than the mean of comparisons, and no more than 1.
        "K5 far fence" => match exact {
            Expectation::Holds { bound } => Expectation::Holds { bound: bound.max(0.2) },
            _ => exact,
        },
        // Pages at 60 degrees to the floor, up to 1.1 m above it of 3 m, 8 m wide in all: within each, 0.41 m from its sides
        // at most. A strip 0.4 m wide at all slopes, 1 m and more above the floor; casters are 7.2 m wide in all.
        "HC-19 three and four triangles on an edge" => {
            let spread = kernel.spread * 3f64.sqrt() * 8.0 * texel / size / 3.0;
            behind_slopes(exact, bound.leak(1.1 / 3.0, spread), 0.42 / (8.0 / size))
        }
        // A triangle that rises by a half, 1 m above the floor and more, of a range of 4 m; 0.42 m from its sides at most. The
        // triangles are 3 m wide in all.
        "K19 odd triangles" => {
            let spread = kernel.spread * 0.5 * 3.0 * texel / size / 4.0;
            behind_slopes(exact, bound.leak(0.25, spread), 0.42 / (3.0 / size))
        }
        "HC-20 winding without a side" => {
            let steep = matches!(bound, Bound::Variance { .. } | Bound::Layers { .. });
            behind_slopes(exact, if steep { 1.0 } else { 0.0 }, 0.2 / (7.2 / size))
        }
        // The floor lies behind the caster, which is level, by half of the range at least.
        "HC-01 A, point light"
        | "HC-01 B, sun overhead"
        | "HC-01 B, turned 30 degrees"
        | "HC-02 light amid the caster" => leaky(exact, bound, size, 0.5, 1.0, 0.0),
        "HC-01 C, slanting sun" => slanting(exact, bound, (kernel.spread, texel), size, size),
        "HC-04 thin wall" | "HC-05 cube" => match bound {
            Bound::Moments { .. } | Bound::Layers { .. } => {
                Expectation::Holds { bound: contact(kernel) * texel }
            }
            Bound::Exponential { sharpness } => match exact {
                Expectation::Holds { bound } => {
                    // Half lit at ln 2 / c of the range behind the caster, which is sqrt 2 m deep and, in a window of
                    // the guard band's width more, up to 4 m wide. A floor point x from the foot is x sqrt 2 behind.
                    let range = std::f64::consts::SQRT_2 + 0.01 + 4.0 * texel;
                    let blunt = std::f64::consts::LN_2 / sharpness * range;
                    let lit = blunt / std::f64::consts::SQRT_2 / (2.0 / size);
                    Expectation::Holds { bound: bound + lit }
                }
                _ => exact,
            },
            _ => exact,
        },
        _ => exact,
    })
}

const FAR_BEHIND: &str = "what is far behind a caster still gets a share of light, however small";

/// HC-09. All that is dark is floor behind the boxes, a slab of 1 m by 1 / tan 40 degrees and one of 0.2 m by 0.86 m more:
/// 1.4 of 15 square metres, of which 9 at least are lit and judged on any map of 128 texels and more.
///
/// Casters are the faces that the light meets, 1.3 m and more before that floor as it sees them. Variance sees how they
/// slope within the kernel: depth changes by tan 40 degrees a metre to the side, of a range of twice the boxes' 2 m, the
/// floor going on behind them, and texels are 1.96 m over the map's side. The others tell two depths apart, and leak where
/// there is a third in the kernel: along the outline of one box on the other, 2.2 m on the floor and 1 / sin 40 degrees as
/// wide as in the map, to either side.
fn crossing(Kernel { reach, spread, .. }: Kernel, bound: Bound, size: f64) -> Expectation {
    use Expectation::{Holds, KnownLimit};
    let (dark, lit) = (1.4, 9.0);
    let texel = 1.96 / size;
    if let Bound::Variance { deviation } = bound {
        // The least spread is the filter's, without the lookup's interpolation.
        let filter = (spread.powi(2) - 0.25).max(0.0).sqrt();
        let slope = 40_f64.to_radians().tan() * filter * texel / 4.0;
        let at_most = dark / (dark + lit);
        return if deviation.powi(2) + slope.powi(2) > 1.1 * WRONG {
            KnownLimit { at_least: f64::MIN_POSITIVE, at_most, because: FAR_BEHIND }
        } else {
            Holds { bound: at_most }
        };
    }
    let strip = 2.2 * 2.0 * reach * texel / 40_f64.to_radians().sin();
    Holds { bound: strip.min(dark) / (dark + lit) }
}

/// HC-01 C, of which `seen` texels a side are looked at: a square of 2 m at 45 degrees to the light.
fn slanting(
    exact: Expectation,
    bound: Bound,
    (spread, texel): (f64, f64),
    size: f64,
    seen: f64,
) -> Expectation {
    // It is sqrt 2 m deep, in a window 2 texel m wide. The range goes on behind it by the window's width.
    let (deep, wide) = (std::f64::consts::SQRT_2, 2.0 * texel);
    let range = deep + wide;
    // Depth changes by as much as one goes to the side.
    let spread = spread * wide / size / range;
    leaky(exact, bound, seen.min(size), 1.0 - deep / range, 1.0, spread)
}

/// `exact`, or a known limit where casters slope so much that the spread of depth within the kernel leaks `leak`: then all of
/// a shadow is wrong, up to `inside` texels from its edge.
fn behind_slopes(exact: Expectation, leak: f64, inside: f64) -> Expectation {
    match exact {
        Expectation::Holds { bound } if leak > WRONG => Expectation::KnownLimit {
            at_least: f64::MIN_POSITIVE,
            at_most: bound.max(inside),
            because: "behind a caster that slopes, the spread of its depth within the kernel leaks",
        },
        _ => exact,
    }
}

/// `exact`, or a known limit where the leak in the middle of a shadow counts as wrong: `gap` is the least
/// and `most` the largest distance between caster and receiver.
fn leaky(
    exact: Expectation,
    bound: Bound,
    size: f64,
    gap: f64,
    most: f64,
    spread: f64,
) -> Expectation {
    if bound.leak(gap, spread) <= WRONG {
        return exact;
    }
    // Variance leaks no less than this either; of the others only the upper bound is known.
    let everywhere = matches!(bound, Bound::Variance { deviation }
        if deviation.powi(2) + spread.powi(2) > WRONG * (most.powi(2) + 1e-4));
    Expectation::KnownLimit {
        // The middle of a shadow is about half a map from its edge, or a quarter of that where it is narrow.
        at_least: if everywhere { 0.125 * size } else { 0.0 },
        at_most: size,
        because: "what is far behind a caster still gets a share of light, of the spread of depth within the \
                  kernel over the square of the gap",
    }
}

/// Texels of floor at the foot of a wall, the light at 45 degrees to both, that four moments leave lit.
///
/// Along the light, a floor point x texels of floor from the foot lies x sqrt 2 behind the wall, and a texel of
/// the map is as wide as 1 / sqrt 2 of a texel of floor. The receiver is moved towards the light by the plane's
/// slope, 1, over the kernel's reach, and the cone's, 2 an axis, over its spread. Beyond that, as for
/// comparisons, 2 texels and the reach, and a spread more for the slope of the wall itself within the kernel.
fn contact(Kernel { reach, spread, .. }: Kernel) -> f64 {
    let moved = 0.5 * (reach + 8f64.sqrt() * spread);
    2.0 + reach + moved + spread
}

/// Cases in which casters are level, or nothing at all, and far before a floor that is all behind them: there depths within a
/// kernel are those of the caster and the range's end, so that whatever is made of them is 1 without a caster in the kernel
/// and 0 with nothing else. And those in which no texel changes.
const LEVEL: &[&str] = &[
    "lone receivers",
    "HC-01 A",
    "HC-01 B",
    "HC-03",
    "HC-06",
    "HC-15",
    "HC-16",
    "HC-18",
    "HC-21",
    "HC-22",
    "HC-23",
    "HC-24",
    "HC-25 caster not seen",
    "HC-39",
    "K1 ",
    "K3",
    "K9",
    "K11",
    "K15",
    "K17",
    "K20",
];

/// What theory says of estimates that are 0 where a kernel sees a caster alone, and 1 where it sees none, over kernels as far
/// as `estimator` reaches.
pub(crate) fn of_level_casters(
    map: &MapConfig,
    estimator: &Estimator,
    case: &str,
) -> Option<Expectation> {
    let is_level = LEVEL.iter().any(|name| case.starts_with(name));
    is_level.then(|| antumbra_map::expectation(map, estimator, case)).flatten()
}
