//! Convolution shadow maps.

use antumbra_gpu::{Expectation, Gpu, GpuError, Technique, TechniqueConfig};
use antumbra_map::{Estimator, MapConfig, MapTechnique, expectation as of_a_depth_map};
use serde::{Deserialize, Serialize};

use crate::expectation::WRONG;
use crate::prefilter::{Constant, Prefilter, Recipe, check};
use crate::twin::{Waves, convolution};
use crate::vsm::U;

/// Convolution shadow maps (Annen, Mertens, Bekaert, Seidel, Kautz 2007): the comparison as a series of waves, each of
/// which filters. Converges to percentage-closer filtering with the number of waves, and rings on the way: it errs both
/// ways. 2 bytes a texel and wave; 32 with the default order.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Convolution {
    /// The shadow map.
    pub map: MapConfig,
    /// The kernel.
    pub filter: Prefilter,
    /// Waves, 1 to 32, default 16 as published: 2 channels each. The step is 1 / (2 `order`) of the depth range wide,
    /// and so is what it leaks behind a caster. Memory, filtering and fetches grow with it.
    pub order: u32,
    /// Damping of the coefficients against ringing, exp(-`damping` (k / `order`)²): 0 to 8, default 1.
    pub damping: f32,
    /// Factor on the series, 1 to 2, default 2, so that what is level with its caster, 1/2 by the series, is fully lit.
    /// Shadows shrink: half of a kernel in the dark counts as none.
    pub scale: f32,
    /// Moves the receiver towards the light, share of the depth range, 0 to 0.5, default 0: the other way to light what is
    /// level with its caster.
    pub offset: f32,
    /// Room in the period between the ends of the depth range, share of it, 0 to 1; `None`, the default, for
    /// 1 / `order`. The series has a period, so without room a floor at the far end is half lit behind a caster at the near
    /// one; depth being fitted to the casters, that is the usual case.
    pub margin: Option<f32>,
    /// Whether the waves are kept at 8 bits a channel as published, default true: off by 0.005 of visibility at most.
    /// Without, four times the memory.
    pub quantised: bool,
}

impl Default for Convolution {
    fn default() -> Self {
        Self {
            map: MapConfig::default(),
            filter: Prefilter::default(),
            order: 16,
            damping: 1.0,
            scale: 2.0,
            offset: 0.0,
            margin: None,
            quantised: true,
        }
    }
}

impl Convolution {
    /// The room in the period.
    #[must_use]
    pub fn effective_margin(&self) -> f64 {
        self.margin.map_or_else(|| f64::from(self.order.max(1)).recip(), f64::from)
    }

    fn recipe(&self) -> Result<Recipe, GpuError> {
        self.filter.validate()?;
        if !(1..=32).contains(&self.order) {
            let (what, fix) = ("order", "use 1 to 32 waves");
            return Err(GpuError::Invalid { what, value: self.order.to_string(), fix });
        }
        check("damping", self.damping, 0.0..=8.0, "use 0 to 8")?;
        check("scale", self.scale, 1.0..=2.0, "use 1 to 2")?;
        check("offset", self.offset, 0.0..=0.5, "use 0 to 0.5 of the depth range")?;
        let margin = self.effective_margin();
        check("margin", margin as f32, 0.0..=1.0, "use 0 to 1, or none for 1 / order")?;
        let layers = self.order.div_ceil(2);
        let constants = vec![
            ("ORDER", Constant::Float(self.order.into())),
            ("SLICES", Constant::Int(layers)),
            ("SQUEEZE", Constant::Float((1.0 + margin).recip())),
            ("DAMPING", Constant::Float(self.damping.into())),
            ("SCALE", Constant::Float(self.scale.into())),
            ("OFFSET", Constant::Float(self.offset.into())),
            ("ROUNDING", Constant::Float(self.rounding())),
        ];
        let format = if self.quantised {
            wgpu::TextureFormat::Rgba8Unorm
        } else {
            wgpu::TextureFormat::Rgba32Float
        };
        let encoding = "filter::encoding::waves";
        let mut recipe =
            Recipe::new(self.filter, encoding, format, "filter::convolution", constants);
        recipe.slices = (0..layers).map(|i| [(2 * i + 1) as f32, 0.0]).collect();
        recipe.fetches = 4 * layers;
        Ok(recipe)
    }

    /// By how much, as a share of the depth range, the receiver is moved so that errors of the stored waves do not darken
    /// what the exact series lights: their sum over the series' slope where it begins. The sum of the k-th term's error is
    /// at most its coefficient times sqrt(2) times a channel's.
    fn rounding(&self) -> f64 {
        let (error, slope) = self.error_and_slope();
        // The series is concave from 0 to its first crest, so half of its slope holds for half of the way there; the
        // error is far less than that.
        let squeeze = (1.0 + self.effective_margin()).recip();
        2.0 * error / (slope * squeeze) + 4.0 * U
    }

    /// Bound on what errors of the stored waves make of the series, and the series' slope where it begins.
    fn error_and_slope(&self) -> (f64, f64) {
        let order = f64::from(self.order);
        let (mut error, mut slope) = (0.0, 0.0);
        // Half a step of 8 bits of a range of 2; or the filter's rounding, and 2^-11 for a sine and a cosine (WGSL
        // promises no more), on both sides.
        let sine = 2f64.powi(-11);
        let channel =
            if self.quantised { 1.0 / 255.0 } else { self.filter.rounding() } + 2.0 * sine;
        for k in 1..=self.order {
            let c = std::f64::consts::PI * (2.0 * f64::from(k) - 1.0);
            let damped = (-f64::from(self.damping) * (f64::from(k) / order).powi(2)).exp();
            error += 2.0 / c * damped * std::f64::consts::SQRT_2 * channel;
            slope += 2.0 * damped;
        }
        (error, slope)
    }

    /// The least light, but for errors of the stored waves, of a receiver at the far end of the range under a caster at
    /// the near one that fills its kernel.
    fn least_leak(&self) -> f64 {
        let waves = Waves {
            order: self.order,
            damping: self.damping.into(),
            margin: self.effective_margin(),
            offset: self.offset.into(),
            scale: self.scale.into(),
        };
        let leak = convolution(&[(0.0, 1.0)], &waves, 1.0 - self.rounding());
        leak - f64::from(self.scale) * self.error_and_slope().0
    }

    /// The estimator, for any layout.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn estimator(&self) -> Result<Estimator, GpuError> {
        Ok(self.recipe()?.estimator())
    }

    /// The technique, with its map and store at hand.
    ///
    /// # Errors
    /// A setting out of range or beyond the device's limits.
    pub fn technique(&self, gpu: &Gpu) -> Result<MapTechnique, GpuError> {
        self.recipe()?.technique(gpu, &self.map)
    }
}

impl TechniqueConfig for Convolution {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(self.technique(gpu)?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        let lit = ["lone receivers", "HC-03", "HC-10", "HC-24 light at a vertex"];
        let whole = self.scale == 2.0 && self.margin.is_none() && self.quantised;
        match case {
            // The series is at least 1/2 behind every texel of the receiver's own surface, and twice that is 1.
            _ if whole && lit.iter().any(|name| case.starts_with(name)) => {
                of_a_depth_map(&self.map, &self.estimator().ok()?, case)
            }
            // A level caster is the nearest there is and its floor as far as the range goes, so all of the shadow gets
            // the same light. The sample farthest from the edge lies in the middle of the square, to within a quarter for
            // the few that do.
            "HC-01 A, point light" | "HC-01 B, sun overhead" | "HC-01 B, turned 30 degrees"
                if self.least_leak() > WRONG =>
            {
                let (sin, cos) = 30_f64.to_radians().sin_cos();
                let turned = if case.ends_with("degrees") { sin + cos } else { 1.0 };
                let middle = 0.5 * f64::from(self.map.size) / turned;
                Some(Expectation::KnownLimit {
                    at_least: 0.75 * middle,
                    at_most: middle,
                    because: "the series rings: where it has come to the end of the range it is not 0",
                })
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_range_are_refused_with_a_fix() {
        assert!(Convolution::default().estimator().is_ok(), "the defaults");
        for config in [
            Convolution { order: 0, ..Convolution::default() },
            Convolution { order: 33, ..Convolution::default() },
            Convolution { damping: f32::NAN, ..Convolution::default() },
            Convolution { scale: 0.5, ..Convolution::default() },
            Convolution { offset: -0.1, ..Convolution::default() },
            Convolution { margin: Some(2.0), ..Convolution::default() },
        ] {
            assert!(matches!(config.estimator(), Err(GpuError::Invalid { .. })), "{config:?}");
        }
    }
}
