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
}

/// Rounding of depths and of sums of areas: 2304 terms of 2^-24, and as much for their coordinates.
const ROUNDING: f64 = 3e-4;

/// What theory says of a technique over a map from the light's centre.
pub(crate) fn over_a_map(map: &MapConfig, accuracy: &Accuracy, case: &str) -> Option<Expectation> {
    use Expectation::{Holds, KnownLimit};
    let size = f64::from(map.size);
    Some(match case {
        "area light of any size" => Holds { bound: accuracy.apart + ROUNDING },
        "area light, contact" => Holds { bound: accuracy.contact + ROUNDING },
        "area light, caster at it" => KnownLimit {
            at_least: 0.99,
            at_most: 1.0,
            because: "a view from the light's centre ends 72 degrees off its axis: of what is at the light it holds a spot",
        },
        // In 12 frames the plate's share, all of the light below its middle, goes and comes back. Whatever rises by 0.9 and
        // falls again in n steps has a second difference of 16 / n^2 of that.
        "area light, passing ball" => KnownLimit {
            at_least: 0.1,
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

/// What theory says of slices, `count` of them at equal distances.
pub(crate) fn of_slices(map: &MapConfig, count: u32, case: &str) -> Option<Expectation> {
    use Expectation::{Holds, KnownLimit};
    let (size, count) = (f64::from(map.size), f64::from(count));
    // An edge that is moved by e towards the receiver moves on the light by at most e z_p / (z (z_p - z)) of it.
    let moved = |e: f64, z: f64, receiver: f64| e * receiver / (z * (receiver - z));
    Some(match case {
        // One edge an axis, or two that are moved less.
        "area light of any size" => Holds { bound: 2.0 * moved(2.0 / count, 4.0, 6.0) + ROUNDING },
        "area light, contact" => KnownLimit {
            at_least: 0.0,
            at_most: 1.0,
            because: "a wall is in every slice, and each counts as if it hid points of the light of its own",
        },
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
