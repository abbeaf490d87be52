//! What theory says of soft shadows on each hard case.

use antumbra_gpu::Expectation;
use antumbra_map::{Estimator, MapConfig};

/// Cases whose lights have no extent, under which every technique here is the plain shadow map, bit for bit.
pub(crate) fn expectation(map: &MapConfig, case: &str) -> Option<Expectation> {
    let case = if case == "area light of no size" { "HC-01 A, point light" } else { case };
    antumbra_map::expectation(map, &Estimator::nearest(), case)
}

/// How far a technique over a map from the light's centre is off behind one plate parallel to the light, share of the light,
/// beyond what the map's texels explain.
pub(crate) struct Accuracy {
    /// Behind a plate 2 m from a floor 6 m from the light, of which the map sees 8 m.
    pub(crate) apart: f64,
    /// Behind the lid, 1 m up, of a box on a floor 10 m from the light, of which the map sees 1.6 m.
    pub(crate) contact: f64,
    /// By how much that may differ behind one edge of a plate 5 m from a floor 10 m from the light, of which the map sees 6 m.
    pub(crate) edge: f64,
    /// Slope of the bias cone, within which nothing hides any light.
    pub(crate) cone: f64,
    /// Texels around a receiver's own that name triangles, a side.
    pub(crate) named: u32,
    /// By how much it grows lighter below the middle of a plate, 6 m from a light of half size 1, as a ball of 0.2 m hides
    /// the plate from the light's centre, 2 m from it.
    pub(crate) rise: f64,
}

impl Accuracy {
    /// Exact, for what lies before the light alone: the plate hides all of the light, and the ball 0.05 of it.
    pub(crate) fn of(map: &MapConfig) -> Self {
        let cone = f64::from(map.bias.cone);
        Self { apart: 0.0, contact: 0.0, edge: 0.0, cone, named: 0, rise: 0.9 }
    }
}

/// `rise` where the mean depth of a window counts. Beside the plate, with its middle 0.19 of slope off, the ball widens the
/// filter's window: 0.049 of it at 2 m and 0.043 at 6 m have their mean at 3.9 m, in whose window of 0.32 both together are
/// 0.33 by moments and 0.37 by counting. Before the plate the ball alone leaves 0.95.
pub(crate) const HANDED_OVER: f64 = 0.95 - 0.67;

/// The light of half size 10 that is 6 m above the floor sees a window of 6 2/3 m at the height of the plate of 2 m, which
/// hides that share of it: less by the step by which silhouettes may be off, a 64th of 8 m seen at that height.
fn small_share() -> f64 {
    ((1.0 - 8.0 / 64.0 * 4.0 / 6.0) * 3.0 / 10.0_f64).powi(2)
}

/// Whatever rises by `rise` and falls again in 12 frames has a second difference of that.
fn hand_over(rise: f64) -> f64 {
    16.0 / 144.0 * rise
}

const AT_THE_LIGHT: Expectation = Expectation::KnownLimit {
    at_least: 0.99,
    at_most: 1.0,
    because: "a view from the light's centre ends 72 degrees off its axis: of what is at the light it holds a spot",
};

/// Rounding of depths and of sums of areas: 2304 terms of 2^-24, and as much for their coordinates.
const ROUNDING: f64 = 3e-4;

/// What theory says of a technique over a map from the light's centre.
pub(crate) fn over_a_map(map: &MapConfig, accuracy: &Accuracy, case: &str) -> Option<Expectation> {
    use Expectation::{Holds, KnownLimit};
    let size = f64::from(map.size);
    if accuracy.named > 0
        && let Some(whole) = antumbra_map::without_holes(case)
    {
        return Some(whole);
    }
    Some(match case {
        // From the floor's corners what the rays from the centre pass at the height of the plate is 2.4 m from it: more than
        // the 2 m that it is up.
        "area light of any size" if accuracy.cone >= 1.0 => KnownLimit {
            at_least: small_share() - ROUNDING,
            at_most: small_share().max(accuracy.apart) + ROUNDING,
            because: "whatever rises from a receiver within the bias cone is taken for its own surface",
        },
        "area light of any size" => Holds { bound: accuracy.apart + ROUNDING },
        "area light, contact" => Holds { bound: accuracy.contact + ROUNDING },
        // Either of the plate's two triangles hides half of the light. The view is 2 x 3.08 wide 1 m off, and so many of its
        // texels lie across the 6 m of floor 10 m off: where those around a receiver are on both sides of the plate's diagonal
        // both are named.
        "area light, caster at it" if accuracy.named > 0 => {
            let across = 6.0 / (10.0 * 2.0 * 3.08) * size;
            let alone = 1.0 - f64::from(2 * accuracy.named + 1) / across;
            KnownLimit {
                at_least: 0.5 * alone.max(0.0).powi(2),
                at_most: 0.5,
                because: "of what is at the light the map holds a spot: texels around a receiver name one triangle of two",
            }
        }
        "area light, caster at it" => AT_THE_LIGHT,
        "area light, passing ball" => KnownLimit {
            at_least: hand_over(accuracy.rise),
            at_most: 2.0,
            because: "what the ball hides from the light's centre is not in the map, and comes back all at once",
        },
        // A texel of 6 m / 10 m of slope over the map's side hides k = 5 * 10 / 5 times as much of the light, 2 m wide. An
        // edge is off by up to one, or by a block of texels of which one is looked at, of a window 0.35 of the map wide. What
        // lies in an interval has a second difference of at most twice its length.
        "area light, sinking plate" => {
            let block = (0.35 * size / 64.0).ceil().max(1.0);
            Holds { bound: 2.0 * (block * 10.2 * 0.6 / 2.0 / size + accuracy.edge) + ROUNDING }
        }
        _ => return expectation(map, case),
    })
}

/// What theory says of slices, none thicker than of `count` at equal distances.
pub(crate) fn of_slices(map: &MapConfig, count: f64, case: &str) -> Option<Expectation> {
    use Expectation::Holds;
    let size = f64::from(map.size);
    // An edge that is moved by e towards the receiver moves on the light by at most e z_p / (z (z_p - z)) of it.
    let moved = |e: f64, z: f64, receiver: f64| e * receiver / (z * (receiver - z));
    Some(match case {
        // One edge an axis, or two that are moved less.
        "area light of any size" => Holds { bound: 2.0 * moved(2.0 / count, 4.0, 6.0) + ROUNDING },
        // The lid is moved by a slice; and in each slice the walls may fill a row of texels, seen from 24 m behind the light
        // through its outline, where the window is 0.2 of what is left to the floor.
        "area light, contact" => {
            let texel = 2.0 * (9.0 + 24.0 + 1.0) / 24.0 / size;
            let open = |k: u32| 1.0 - (texel / (0.2 * (1.0 - f64::from(k) / count))).min(1.0);
            let walls: f64 = (1..count.ceil() as u32).map(open).product();
            Holds { bound: (moved(1.0 / count, 9.0, 10.0) + 1.0 - walls).min(1.0) }
        }
        "area light, caster at it" => Holds { bound: ROUNDING },
        // The plate is in a slice of its own whatever passes before it. Of the light the ball hides 0.049, and 1.3 times that
        // flattened; the truth has 4096 samples, a 64th of a side apart.
        "area light, passing ball" => Holds { bound: 2.0 * (0.049 + 0.065) + 4.0 * 0.5 / 64.0 },
        // Slices sink with the plate, so that it keeps its place in one. Of an image 4.2 m wide at the slice's plane, kernels
        // 0.88 m wide see an edge to a texel.
        "area light, sinking plate" => Holds { bound: 2.0 * 4.2 / (0.88 * size) + ROUNDING },
        _ => return expectation(map, case),
    })
}

/// What theory says of a single light sample, which is lit where the light's centre is seen, and behind a straight edge
/// 1 + `bias` - `scale` t of the light at t halves of the penumbra inside its hard shadow, where (1 - t) / 2 is true.
pub(crate) fn of_widths(map: &MapConfig, scale: f64, bias: f64, case: &str) -> Option<Expectation> {
    use Expectation::{Holds, KnownLimit};
    let size = f64::from(map.size);
    let outside =
        "all that the light's centre sees is lit, up to half of which is hidden by an edge";
    Some(match case {
        // Of 512 samples some lie within 5 cm of the 12 m of the hard shadow's edge, in a penumbra of 1 m; the step is as much
        // of it as in `small_share`.
        "area light of any size" => KnownLimit {
            at_least: 0.5 - 8.0 / 64.0 - 0.05,
            at_most: if scale == 1.0 { 0.5 + bias.max(0.0) } else { 1.0 },
            because: outside,
        },
        // At the edge, which is known to a texel or two of 1.6 m.
        "area light, contact" => KnownLimit {
            at_least: 0.5 - 4.5 * (1.6 * 0.9 / 64.0 + 1.5 * 1.6 / size),
            at_most: 0.75,
            because: outside,
        },
        // As wide as the shadow is, the penumbra of what is at the light is wider.
        "area light, caster at it" => AT_THE_LIGHT,
        // The middle of the plate's shadow is 0.83 m from its border, and half the penumbra 0.67 m: dark. The ball's is 1 m of 4.
        "area light, passing ball" if scale == 1.0 => KnownLimit {
            at_least: hand_over(0.75 - bias.max(0.0)),
            at_most: 2.0,
            because: "what the ball hides from the light's centre is not in the map, and comes back all at once",
        },
        "area light, passing ball" => return None,
        // The border moves by 6.7 mm a frame, on which light may begin or end to rise by `scale` a metre, or twice as much
        // in truth; and by a texel, of 6 m at most.
        "area light, sinking plate" => {
            Holds { bound: (scale + 0.5) * 0.0067 + 2.0 * scale * 6.25 / size + ROUNDING }
        }
        _ => return expectation(map, case),
    })
}

/// What theory says of the nearest texel that is hidden or lit where the receiver is not: right behind straight edges, and
/// one half at every edge.
pub(crate) fn of_search(map: &MapConfig, named: u32, case: &str) -> Option<Expectation> {
    use Expectation::KnownLimit;
    let accuracy = Accuracy { named, rise: 0.375, ..Accuracy::of(map) };
    Some(match case {
        // The plate hides 0.001 of the largest light; of the next, in the middle, at most 0.106 where 0.35 is left, that being
        // 0.3 of half the penumbra inside the shadow.
        "area light of any size" => KnownLimit {
            at_least: 0.48,
            at_most: 0.55,
            because: "where the light's centre is hidden at least half of the light is taken to be",
        },
        "area light, caster at it" if named == 0 => KnownLimit {
            at_least: 0.48,
            at_most: 0.5,
            because: "beyond the view's border all counts as lit, which is near in so wide a penumbra: one half",
        },
        // From 0 to (1 - 1 / 4) / 2, the middle of the ball's shadow being 1 m from its border in half a penumbra of 4 m.
        _ => return over_a_map(map, &accuracy, case),
    })
}
