//! Cases of casters with holes.

use antumbra_gpu::{Gpu, Technique};
use antumbra_reference::ViewSample;
use antumbra_scene::generate;
use glam::{DVec2, DVec3};

use super::unit_cube;
use crate::{MeasureError, Stage};

/// Samples of the card's shadow.
const SAMPLES: usize = 1 << 14;

/// Room to either side of an edge, texels: as for the cases that are seen by a camera.
const BAND: f64 = 8.0;

/// Points of the checker's shadow, as coordinates on the card in cells, with what a technique makes of them.
fn checker(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    cells: u32,
) -> Result<Vec<(DVec2, f32)>, MeasureError> {
    let scene = generate::checker_card(cells);
    let light = scene.lights[0];
    // The card faces the light, so that a place on it, moved along the light, is its shadow's: down to y = 0 from y.
    let to_light = DVec3::new(0.0, 1.0, 1.0).normalize();
    let down = to_light.cross(DVec3::X);
    let places: Vec<DVec2> = unit_cube(SAMPLES).map(|[a, b, _]| DVec2::new(a, b)).collect();
    let samples: Vec<ViewSample> = places
        .iter()
        .map(|p| {
            let on_card = 5.0 * to_light + DVec3::X * (p.x - 0.5) + down * (p.y - 0.5);
            let shadow = on_card - to_light * (on_card.y / to_light.y);
            ViewSample { position: shadow.as_vec3(), normal: glam::Vec3::Y }
        })
        .collect();
    let stage = Stage::at_points(gpu, &scene, &samples)?;
    let shot = stage.shoot(gpu, &light, technique, 0)?;
    let cells = f64::from(cells);
    Ok(places.into_iter().map(|p| p * cells).zip(shot.visibility).collect())
}

/// HC-35, cells of 64 texels: the share of wrong samples away from the cells' edges.
pub(super) fn cells(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    let count = (map_size / 64).max(1);
    let band = BAND * f64::from(count) / f64::from(map_size);
    let (mut wrong, mut judged) = (0_u32, 0_u32);
    for (place, v) in checker(gpu, technique, count)? {
        let inside = place.fract();
        if inside.min(1.0 - inside).min_element() < band {
            continue;
        }
        let lit = (place.x as u32 + place.y as u32) % 2 == 1;
        judged += 1;
        // Asked this way round, NaN is wrong.
        let right = if lit { v > 0.5 } else { v <= 0.5 };
        wrong += u32::from(!right);
    }
    Ok(f64::from(wrong) / f64::from(judged))
}

/// HC-35, cells of a texel: how far the mean visibility of the shadow is off a half.
pub(super) fn mean(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    let margin = BAND;
    let inner = |p: &DVec2| p.min(f64::from(map_size) - *p).min_element() >= margin;
    let seen = checker(gpu, technique, map_size)?;
    let judged: Vec<f64> =
        seen.iter().filter(|(p, _)| inner(p)).map(|(_, v)| f64::from(*v)).collect();
    Ok((judged.iter().sum::<f64>() / judged.len() as f64 - 0.5).abs())
}
