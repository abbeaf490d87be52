//! Summed-area variance shadow maps.

use antumbra_gpu::{
    Counters, Expectation, Frame, Gpu, GpuError, LayerJob, Recorder, Sat, SatNumbers, SatShader,
    Technique, TechniqueConfig,
};
use antumbra_map::{Estimator, MapConfig, MapRead, MapTechnique, ShadowMap, Store};
use antumbra_shaders::module;
use serde::{Deserialize, Serialize};

use crate::expectation::{Bound, Kernel, expectation};
use crate::eye::Eye;
use crate::prefilter::{Constant, check, constants};
use crate::twin::coverage_spread;
use crate::vsm::{U, check_cut};

/// How the table keeps its sums.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Table {
    /// Integers modulo 2^32, of as many bits a value as the largest kernel leaves: windows are exact wherever they lie.
    #[default]
    Fixed,
    /// Floats about the middle of the range, as first published. What is rounded grows with the map and not with the
    /// kernel: from 512 texels on small kernels see noise.
    Float,
}

/// Summed-area variance shadow maps (Lauritzen 2007): a variance shadow map whose kernel, a box of any size, is chosen at
/// each sample, for 16 reads whatever its size. 8 bytes a texel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Savsm {
    /// The shadow map.
    pub map: MapConfig,
    /// Least radius of the kernel, texels, 0 to `largest`, default 0.5: a box of 2 `radius` + 1 texels a side, 2 as
    /// published, whose edges may lie anywhere.
    pub radius: f32,
    /// Largest radius, texels, 0 to 127, default 7.5. Integers have fewer bits the larger it is (24 at 7, 20 at 31, 16 at
    /// 127), and the map a guard band of it around the casters.
    pub largest: f32,
    /// Whether kernels grow to the box around the pixel's footprint in the map, so that a minified map does not alias.
    /// Default true; without it, or without a camera, all have the least radius.
    pub follow_pixels: bool,
    /// How sums are kept, default integers.
    pub table: Table,
    /// Least standard deviation of depth, share of the depth range, 0 to 1, default 1e-3; see [`crate::Vsm`].
    pub deviation: f32,
    /// Visibility below which all is dark, what is above being stretched to fill: 0 to 0.99, default 0.
    pub cut: f32,
}

impl Default for Savsm {
    fn default() -> Self {
        Self {
            map: MapConfig::default(),
            radius: 0.5,
            largest: 7.5,
            follow_pixels: true,
            table: Table::default(),
            deviation: 1e-3,
            cut: 0.0,
        }
    }
}

impl Savsm {
    /// How numbers are kept in the table: with windows of up to this side, whose edges cut a texel at either end.
    #[must_use]
    pub fn numbers(&self) -> SatNumbers {
        match self.table {
            Table::Fixed => {
                let most = self.most_radius().clamp(0.0, 127.0);
                SatNumbers::fixed((2.0 * f64::from(most) + 1.0).ceil() as u32 + 1)
            }
            Table::Float => SatNumbers::Float,
        }
    }

    fn most_radius(&self) -> f32 {
        if self.follow_pixels { self.largest } else { self.radius }
    }

    /// Bound on what quantisation and joining move the mean of a window, share of the depth range. What a table of floats
    /// rounds beyond is left to `deviation` to hide, as published: a bound on it would leave no shadow.
    fn rounding(&self) -> f64 {
        // 16 windows are rounded to floats, weighted and added, and the sum is divided by the area and the scale.
        let joined = 24.0 * U;
        match self.numbers() {
            numbers @ SatNumbers::Fixed { .. } => 0.5 / numbers.scale() + joined,
            SatNumbers::Float => joined,
        }
    }

    fn checked(&self) -> Result<(), GpuError> {
        const FIX: &str = "use 0 to 127 texels, the least no larger than the largest";
        check("largest", self.largest, 0.0..=127.0, FIX)?;
        check("radius", self.radius, 0.0..=self.most_radius(), FIX)?;
        check("radius", self.radius, 0.0..=127.0, FIX)?;
        check("deviation", self.deviation, 0.0..=1.0, "use 0 to 1 of the depth range")?;
        check_cut(self.cut)
    }

    /// The estimator, for any layout. It reads the camera in bind group 2.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn estimator(&self) -> Result<Estimator, GpuError> {
        self.checked()?;
        let (store, read) = match self.table {
            Table::Fixed => ("filter::table_fixed", MapRead::Unsigned),
            Table::Float => ("filter::table_float", MapRead::Texels),
        };
        let config = constants(&[
            ("HALF", Constant::Float(f64::from(self.radius) + 0.5)),
            ("MOST", Constant::Float(f64::from(self.most_radius()) + 0.5)),
            ("FOLLOW", Constant::Bool(self.follow_pixels)),
            ("SCALE", Constant::Float(self.numbers().scale())),
            ("LEAST_VARIANCE", Constant::Float(f64::from(self.deviation).powi(2))),
            ("CUT", Constant::Float(self.cut.into())),
            // The receiver's own depth is rounded, too.
            ("ROUNDING", Constant::Float(self.rounding() + U)),
        ]);
        Ok(Estimator {
            slots: vec![module("store", store), module("estimator", "filter::savsm"), config],
            read,
            radius: self.most_radius() + 1.0,
            reach: 0.0,
            fetches: 16,
        })
    }

    /// The technique, with its map and table at hand.
    ///
    /// # Errors
    /// A setting out of range or beyond the device's limits.
    pub fn technique(&self, gpu: &Gpu) -> Result<MapTechnique, GpuError> {
        let estimator = self.estimator()?;
        let encoding = match self.table {
            Table::Fixed => "filter::encoding::variance_fixed",
            Table::Float => "filter::encoding::variance",
        };
        let shader = SatShader {
            texel: "filter::from_depth",
            slots: vec![module("encoding", encoding)],
            channels: 2,
            numbers: self.numbers(),
        };
        let table = Tables { sat: Sat::new(gpu, &shader)?, eye: Eye::new(gpu), jobs: Vec::new() };
        MapTechnique::with_store(gpu, &self.map, estimator, Box::new(table))
    }
}

impl TechniqueConfig for Savsm {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(self.technique(gpu)?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        // What a table of floats loses is not derived for each case.
        if self.table == Table::Float {
            return None;
        }
        // The cases where the spread counts have no camera, so that kernels have the least radius.
        let spread = coverage_spread(f64::from(self.radius) + 0.5);
        let reach = f64::from(self.most_radius()) + 1.0;
        let kernel = Kernel { reach, spread, widest: spread };
        let bound = Bound::Variance { deviation: self.deviation.into() };
        expectation(&self.map, kernel, bound, case)
    }
}

/// Tables of the map's moments.
#[derive(Debug)]
struct Tables {
    sat: Sat,
    eye: Eye,
    jobs: Vec<LayerJob>,
}

impl Store for Tables {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>, map: &ShadowMap) -> Result<(), GpuError> {
        self.eye.prepare(gpu, frame);
        self.jobs.clear();
        let Some(view) = map.view() else { return Ok(()) };
        self.jobs.extend(map.linear_depths().iter().enumerate().map(|(layer, linear)| LayerJob {
            source: layer as u32,
            parameters: [
                linear.coefficients.map(|c| c as f32),
                [0.0, 0.0, 0.0, linear.last_caster as f32],
            ],
        }));
        self.sat.prepare(gpu, view, map.size(), &self.jobs)
    }

    fn encode(
        &mut self,
        _gpu: &Gpu,
        _frame: &Frame<'_>,
        _map: &ShadowMap,
        recorder: &mut Recorder<'_>,
    ) -> Result<(), GpuError> {
        if !self.jobs.is_empty() {
            self.sat.encode(recorder, "filter/sum");
        }
        Ok(())
    }

    fn group_layout(&self) -> Option<&wgpu::BindGroupLayout> {
        Some(self.eye.layout())
    }

    fn group(&self) -> Option<&wgpu::BindGroup> {
        self.eye.group()
    }

    fn needs_receivers(&self) -> bool {
        true
    }

    fn view(&self) -> Option<&wgpu::TextureView> {
        self.sat.view()
    }

    fn counters(&self) -> Counters {
        let texels = if self.jobs.is_empty() { 0 } else { self.sat.texels() };
        // A thread adds up its span of a line, and adds it up again from where the others' spans end (`gpu/sat.wesl`).
        Counters::from([
            ("store_layers", self.jobs.len() as u64),
            ("store_texels", texels),
            ("store_taps", 2 * texels),
        ])
    }

    fn bytes(&self) -> u64 {
        self.sat.bytes() + self.eye.bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_range_are_refused_with_a_fix() {
        assert!(Savsm::default().estimator().is_ok(), "the defaults");
        for config in [
            Savsm { radius: 8.0, ..Savsm::default() },
            Savsm { radius: -1.0, ..Savsm::default() },
            Savsm { radius: f32::NAN, ..Savsm::default() },
            Savsm { largest: 128.0, ..Savsm::default() },
            Savsm { deviation: 2.0, ..Savsm::default() },
            Savsm { cut: 1.0, ..Savsm::default() },
            Savsm { radius: 500.0, follow_pixels: false, ..Savsm::default() },
        ] {
            let refused = config.estimator();
            assert!(matches!(refused, Err(GpuError::Invalid { .. })), "{config:?}");
        }
    }

    #[test]
    fn windows_of_the_largest_kernel_fit_the_numbers() {
        for (largest, bits) in [(7.0, 24), (31.0, 20), (127.0, 16), (7.5, 23)] {
            let config = Savsm { largest, ..Savsm::default() };
            let numbers = config.numbers();
            assert_eq!(numbers, SatNumbers::Fixed { bits }, "a radius of {largest}");
        }
    }
}
