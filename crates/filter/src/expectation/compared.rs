//! What theory says of comparisons texel by texel, and of those that are joined over a block of pixels.

use std::f64::consts::SQRT_2;

use antumbra_gpu::Expectation;
use antumbra_map::{Estimator, MapConfig};

/// What theory says of comparisons over a kernel.
pub(crate) fn compared(map: &MapConfig, estimator: &Estimator, case: &str) -> Option<Expectation> {
    let usual = antumbra_map::expectation(map, estimator, case)?;
    if case == "K17 edge across splits" && rises_above_plate(map, estimator) {
        return Some(Expectation::KnownLimit {
            at_least: f64::MIN_POSITIVE,
            at_most: PLATE_HEIGHT / texel_of_plate(map),
            because: "within a kernel as wide as that the bias cone rises above the plate, so that some taps are lit \
                      everywhere below it",
        });
    }
    Some(usual)
}

/// K17: height of the plate above the floor, metres. No sample in shadow is farther from the plate's plane, which is as
/// far as the number looks (`shadow_margin`).
const PLATE_HEIGHT: f64 = 3.0;

/// K17: side of a texel of the ideal map, metres: the plate is 210 m long. A little less, for rounding.
fn texel_of_plate(map: &MapConfig) -> f64 {
    210.0 / f64::from(map.size) * (1.0 - 1e-9)
}

/// K17: whether the bias cone at the kernel's corner reaches the plate from the floor, in texels that a guard band and steps
/// of the window, of an eighth of an octave, make larger.
fn rises_above_plate(map: &MapConfig, estimator: &Estimator) -> bool {
    let (radius, size) = (f64::from(estimator.radius), f64::from(map.size));
    let band = size / (size - 2.0 * (radius.ceil() + 1.0)).max(1.0);
    let texel = texel_of_plate(map) * band * 0.125_f64.exp2();
    f64::from(map.bias.cone) * SQRT_2 * (radius + f64::from(estimator.reach)) * texel > PLATE_HEIGHT
}

/// What theory says of parts that are joined over the pixels up to `pixels` away an axis, of which all together make
/// `whole`.
///
/// The block around a pixel is symmetric, and on a plane all of it counts. So of a half-plane in shadow no pixel gets the
/// wrong side of one half: that happens only within a block of a corner of a shadow, of the border of the picture, or where a
/// shadow or the light between two of them is narrower than a block.
pub(crate) fn joined(
    map: &MapConfig,
    whole: &Estimator,
    pixels: u32,
    case: &str,
) -> Option<Expectation> {
    use Expectation::{Holds, KnownLimit};
    let usual = compared(map, whole, case)?;
    let Holds { bound } = usual else { return Some(usual) };
    let (size, pixels) = (f64::from(map.size), f64::from(pixels));
    const BLURRED: &str =
        "pixels are joined over a block, which is larger than a texel, or than all of a shadow";
    // How far a joined sample may lie from the one that is wrong by itself, metres, and the side of an ideal texel.
    let farther = |metres: f64, texel: f64| KnownLimit {
        at_least: f64::MIN_POSITIVE,
        at_most: bound + metres / texel,
        because: BLURRED,
    };
    Some(match case {
        // From 4.5 m above, shadows are up to 9.7 m off and seen at 27 degrees to the floor: 2 pixels of 256 over 45 degrees
        // are 6 cm aside, and 14 cm away. Casters are 8 m, 7.2 m and 2 m wide.
        "HC-19 three and four triangles on an edge" => farther(0.2, 8.0 / size),
        "HC-20 winding without a side" => farther(0.2, 7.2 / size),
        "HC-22 vertex on an edge" => farther(0.2, 2.0 / size),
        // A pixel is a texel of the caster wide on the floor, and seen from the light no larger.
        "HC-02 in view" | "HC-23 light at the eye" | "HC-25 caster out of sight" => {
            Holds { bound: bound + SQRT_2 * pixels }
        }
        // A pixel is 0.2 m of a wall of which the casters fill 8.5 m, or 0.19 m of a floor of which the plate hides 3 m.
        "HC-17 beyond the far plane" => {
            Holds { bound: bound + SQRT_2 * pixels * 0.2 / (8.5 / size) }
        }
        "HC-23 lamp at the eye, in view" | "HC-23 light in the near plane" => {
            Holds { bound: bound + SQRT_2 * pixels * 0.19 / (3.0 / size) }
        }
        // Of shadows of one square or half of the floor: four corners, and two edges that leave the picture. A third of 64 x 64
        // pixels is judged at least.
        "HC-15 eye in shadow"
        | "HC-16 boundary near the eye"
        | "HC-16 boundary through the eye"
        | "HC-18 sheets"
        | "HC-18 256 sheets"
        | "HC-25 caster not seen"
        | "K3 light along the view"
        | "K7 slab behind the camera"
        | "K10 flat depth" => {
            let block = (2.0 * pixels + 1.0).powi(2);
            Holds { bound: bound + 6.0 * block / (64.0 * 64.0 / 3.0) }
        }
        // Between the triangle's lower edge and its shadow's, 0.4 degrees of lit floor are seen, which is a row of pixels at
        // most, and below that 35 rows of shadow.
        "K7 crossing triangle" => Holds { bound: bound + 1.0 / 35.0 },
        // Shadows half a row of pixels high in the worst of the pictures.
        "K8 spot lights in view" => {
            KnownLimit { at_least: f64::MIN_POSITIVE, at_most: 1.0, because: BLURRED }
        }
        // The plate's shadow ends 800 m off, 60 m below the eye, and a row of 128 over 90 degrees is 1 / 64 of the depth wide
        // there, which lies on the floor at 60 to 800. Plate and hand are 900 m apart at most.
        "K11 gap of depths" => farther(2.0 / 64.0 * 800.0 * 800.0 / 60.0, 900.0 / size),
        // Rows of the picture are 2 / (128 · 1.7 m) apart in reciprocal distance. From the shadow's far end, at 94 m or under
        // low suns 98 m, to two rows nearer is 47 m, and two pixels aside 1.5 m. The plates' boxes are 90 m long and 46 m
        // wide, of which suns along the floor see only the latter.
        "K1 plates of one size" => farther(48.0, 89.8 / size),
        "K2 tilted suns" => farther(48.0, 45.9 / size),
        // 20 m and at most 100 m off two pixels are a 64th of that wide. An ideal map is 920 m wide, and 99 m.
        "K6 skyline" => Holds { bound: bound + 20.0 / 64.0 / (920.0 / size) },
        "K16 pile-up" => farther(100.0 / 64.0, 99.0 / size),
        // Up to 9 m from the eye, 6 m above the floor, two rows of 128 over 90 degrees are half a metre of floor. The triangles
        // are 3 m wide in all.
        "K19 odd triangles" => farther(2.0 / 64.0 * 81.0 / 6.0, 3.0 / size),
        // At most 250 m off, where two pixels are 4 m wide.
        "K17 edge across splits" => farther(4.0, texel_of_plate(map)),
        // The last row of pixels that ends on the floor sees it at 435 m; the plates' boxes are 8 km long.
        "K20 long horizon" => Holds { bound: bound + 435.0 / (8400.0 / size) },
        _ => usual,
    })
}
