//! Cases of casters that let light through.

use antumbra_gpu::{Gpu, Technique};
use antumbra_reference::ViewSample;
use antumbra_scene::generate;
use glam::Vec3;

use super::unit_cube;
use crate::{MeasureError, Stage};

/// Samples of the panes' shadow.
const SAMPLES: usize = 1 << 13;

/// Room to either side of a pane's edge, metres.
const BAND: f64 = 0.02;

/// HC-36: the largest distance of visibility from 2^-k below k panes, and from 0.001 below the one of 0.999.
pub(super) fn below(gpu: &Gpu, technique: &mut dyn Technique) -> Result<f64, MeasureError> {
    let scene = generate::panes();
    let strips = generate::PANES as f64;
    let known: Vec<(Vec3, f64)> = unit_cube(SAMPLES)
        .filter_map(|[a, b, c]| {
            let along = a * strips;
            let inner = |place: f64| (BAND..=1.0 - BAND).contains(&place);
            let (x, z, left) = if c < 0.9 {
                (along - 5.0, 2.0 * b - 1.0, 0.5_f64.powi(along as i32 + 1))
            } else {
                (2.0 * a - 1.0, 2.0 * b + 2.0, 0.001)
            };
            let clear = inner(b) && inner(if c < 0.9 { along.fract() } else { a });
            clear.then(|| (Vec3::new(x as f32, 0.0, z as f32), left))
        })
        .collect();
    let samples: Vec<ViewSample> =
        known.iter().map(|&(position, _)| ViewSample { position, normal: Vec3::Y }).collect();
    let stage = Stage::at_points(gpu, &scene, &samples)?;
    let shot = stage.shoot(gpu, &scene.lights[0], technique, 0)?;
    let errors =
        known.iter().zip(&shot.visibility).map(|((_, left), v)| (f64::from(*v) - left).abs());
    // NaN is no smaller than anything.
    Ok(errors.fold(0.0, |most, error| if error <= most { most } else { error }))
}
