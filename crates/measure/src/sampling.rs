//! How finely a light's map samples what the camera sees.

use antumbra_gpu::{Gpu, GpuError, Recorder, read_f32_texture};
use antumbra_map::{FittedView, Layout, SamplingError};
use glam::Vec2;

use crate::{MeasureError, Stage};

/// The sampling error at every view sample of a stage.
#[derive(Clone, Debug, PartialEq)]
pub struct Sampling {
    /// Lengths of a texel's sides along s and t, pixels, row by row; 0 where the map is not looked up.
    pub sides: Vec<Vec2>,
}

impl Sampling {
    /// Errors of the samples at which the map is looked up, the longer side each, pixels, ascending.
    #[must_use]
    pub fn errors(&self) -> Vec<f32> {
        let mut errors: Vec<f32> =
            self.sides.iter().map(|s| s.max_element()).filter(|m| *m > 0.0).collect();
        errors.sort_by(f32::total_cmp);
        errors
    }

    /// The error that the given share of the samples (0 to 1) does not exceed, pixels; `None` without samples.
    #[must_use]
    pub fn quantile(&self, share: f64) -> Option<f32> {
        let errors = self.errors();
        let index = (share.clamp(0.0, 1.0) * errors.len() as f64).ceil() as usize;
        errors.get(index.max(1) - 1).copied()
    }

    /// Share of the samples at which a texel is longer than a pixel; 0 without samples.
    #[must_use]
    pub fn undersampled(&self) -> f64 {
        let errors = self.errors();
        let above = errors.iter().filter(|m| **m > 1.0).count();
        if above == 0 { 0.0 } else { above as f64 / errors.len() as f64 }
    }
}

impl Stage {
    /// Measures the sampling error of a map of `size` texels a side, fitted as `views` of `layout`, at this stage's
    /// view samples. Waits.
    ///
    /// # Errors
    /// A stage without a camera, views that are not the layout's, or a lost device.
    pub fn sampling(
        &self,
        gpu: &Gpu,
        layout: Layout,
        views: &[FittedView],
        size: u32,
    ) -> Result<Sampling, MeasureError> {
        let camera = self.camera().ok_or_else(|| GpuError::Invalid {
            what: "camera of the stage",
            value: "none".to_owned(),
            fix: "measure sampling on a stage that a camera sees",
        })?;
        let mut pass = SamplingError::new(gpu, layout)?;
        let target = SamplingError::target(gpu, &self.samples)?;
        let output = target.create_view(&Default::default());
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let mut recorder = Recorder::new(&mut encoder);
        pass.encode(gpu, &mut recorder, camera, &self.samples, views, size, &output)?;
        gpu.queue.submit([encoder.finish()]);
        let texels = read_f32_texture(gpu, &target, 0)?;
        Ok(Sampling { sides: texels.chunks_exact(2).map(Vec2::from_slice).collect() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_leave_out_what_is_not_looked_up() {
        let sides = vec![Vec2::ZERO, Vec2::new(0.5, 0.2), Vec2::new(1.0, 3.0), Vec2::new(0.1, 1.0)];
        let sampling = Sampling { sides };
        assert_eq!(sampling.errors(), [0.5, 1.0, 3.0], "ascending");
        assert_eq!(sampling.quantile(0.0), Some(0.5), "the least");
        assert_eq!(sampling.quantile(0.5), Some(1.0), "the median");
        assert_eq!(sampling.quantile(1.0), Some(3.0), "the most");
        assert!((sampling.undersampled() - 1.0 / 3.0).abs() < 1e-12, "one in three");
        let none = Sampling { sides: vec![Vec2::ZERO] };
        assert_eq!((none.quantile(0.5), none.undersampled()), (None, 0.0), "without samples");
    }
}
