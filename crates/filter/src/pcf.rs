//! The percentage-closer filters, one config each.

use antumbra_gpu::{Expectation, Gpu, GpuError, Technique, TechniqueConfig};
use antumbra_map::{Estimator, MapConfig, MapRead, MapTechnique};
use antumbra_shaders::{Slot, castano_constants, castano_core, module, poisson_constants, source};
use serde::{Deserialize, Serialize};

use crate::expectation::compared;
use crate::kernel::{Separable, poisson_disc, stratified_disc};

/// Largest kernel side: 63 x 63 compares a sample, far beyond what any frame affords; a larger value is
/// surely a mistake.
const MAX_SIDE: u32 = 63;
/// Most Poisson taps: they are constants of the shader.
const MAX_TAPS: u32 = 128;

/// Regular PCF: `side` x `side` nearest texels of equal weight. `side`² + 1 grey levels; an edge becomes a
/// staircase of `side` steps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PcfGrid {
    /// The shadow map.
    pub map: MapConfig,
    /// Texels a side of the kernel, 1 to 63, default 3. Cost: `side`² compares a sample.
    pub side: u32,
}

/// Hardware PCF: the four texels around the sample in one fetch, interpolated, the reconstruction filter for magnified
/// maps.
///
/// The fetch gathers the texels, and each is compared with its own reference depth: the same filter as
/// [`PcfBilinearGrid`] with `side` 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PcfHardware {
    /// The shadow map.
    pub map: MapConfig,
    /// Has the sampler compare and interpolate. Its four texels then share one reference depth, so that the bias is a
    /// texel's slope an axis and half a texel of the cone more: three reference depths a sample less, and more leak at contacts.
    /// Default false.
    pub comparison: bool,
}

/// PCF over a grid of `side` x `side` bilinear taps one texel apart: a continuous response with slope
/// 1 / `side` a texel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PcfBilinearGrid {
    /// The shadow map.
    pub map: MapConfig,
    /// Taps a side, 1 to 63, default 3; 1 is plain bilinear PCF. Cost: (`side` + 1)² compares a sample.
    pub side: u32,
}

/// Castano's smooth kernels (1,2,1), (1,3,4,3,1), (1,5,12,16,12,5,1) with bilinear interpolation
/// ("Shadow Mapping Summary, Part 1", 2013).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PcfCastano {
    /// The shadow map.
    pub map: MapConfig,
    /// 3, 5 or 7 texels, default 5. Cost: (`side` + 1)² compares a sample, or a quarter of that in
    /// hardware.
    pub side: u32,
    /// Uses bilinear comparison fetches (2x2, 3x3, 4x4), each with one reference depth for four texels and
    /// so with more bias on slopes. Default false: texel by texel, exact.
    pub hardware: bool,
}

/// PCF over a Poisson disc, turned by an angle that differs from pixel to pixel (Isidoro 2006): noise
/// instead of bands.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PcfPoisson {
    /// The shadow map.
    pub map: MapConfig,
    /// Taps, 1 to 128, default 12 as published. Cost: one compare each.
    pub taps: u32,
    /// Radius of the disc, texels, 0 to 31, default 2.5, the half width of a 5x5 grid.
    pub radius: f32,
}

/// PCF with the cubic B-spline over 4 x 4 texels (Sigg, Hadwiger 2005): a smooth response of slope 3/4 a texel at
/// most, the smoothest reconstruction of a magnified map here.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PcfCubic {
    /// The shadow map.
    pub map: MapConfig,
}

/// PCF over a disc of 64 taps of which the outermost 8 are looked at first, and the others only where those
/// disagree (Uralsky 2005). What is smaller than the gaps between these 8 and lies within them is missed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PcfAdaptive {
    /// The shadow map.
    pub map: MapConfig,
    /// Taps a side of the grid that is bent into the disc, 2 to 11, default 8 as published. Cost: `side`
    /// compares a sample, and the square of it in the penumbra.
    pub side: u32,
    /// Radius of the disc, texels, 0 to 31, default 2.5.
    pub radius: f32,
    /// Looks at all taps everywhere, default false: to measure what is missed.
    pub exhaustive: bool,
}

impl Default for PcfAdaptive {
    fn default() -> Self {
        Self { map: MapConfig::default(), side: 8, radius: 2.5, exhaustive: false }
    }
}

impl Default for PcfGrid {
    fn default() -> Self {
        Self { map: MapConfig::default(), side: 3 }
    }
}

impl Default for PcfBilinearGrid {
    fn default() -> Self {
        Self { map: MapConfig::default(), side: 3 }
    }
}

impl Default for PcfCastano {
    fn default() -> Self {
        Self { map: MapConfig::default(), side: 5, hardware: false }
    }
}

impl Default for PcfPoisson {
    fn default() -> Self {
        Self { map: MapConfig::default(), taps: 12, radius: 2.5 }
    }
}

impl PcfGrid {
    /// The estimator, for any layout.
    ///
    /// # Errors
    /// A side out of range.
    pub fn estimator(&self) -> Result<Estimator, GpuError> {
        let side = check_side(self.side)?;
        Ok(separable(Separable::Box { side }, "filter::kernel::box", side_constant(side)))
    }
}

impl TechniqueConfig for PcfGrid {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(MapTechnique::new(gpu, &self.map, self.estimator()?)?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        compared(&self.map, &self.estimator().ok()?, case)
    }
}

impl PcfHardware {
    /// The estimator, for any layout.
    #[must_use]
    pub fn estimator(&self) -> Estimator {
        let (store, read, reach) = if self.comparison {
            ("common::compare_map", MapRead::Comparison, 1.0)
        } else {
            ("common::gather_map", MapRead::Gathered, 0.0)
        };
        let slots = vec![module("store", store), module("estimator", "filter::hardware")];
        Estimator { slots, read, radius: 1.0, reach, fetches: 1 }
    }
}

impl TechniqueConfig for PcfHardware {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(MapTechnique::new(gpu, &self.map, self.estimator())?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        compared(&self.map, &self.estimator(), case)
    }
}

impl PcfBilinearGrid {
    /// The estimator, for any layout.
    ///
    /// # Errors
    /// A side out of range.
    pub fn estimator(&self) -> Result<Estimator, GpuError> {
        let side = check_side(self.side)?;
        Ok(separable(Separable::Tent { side }, "filter::kernel::tent", side_constant(side)))
    }
}

impl TechniqueConfig for PcfBilinearGrid {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(MapTechnique::new(gpu, &self.map, self.estimator()?)?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        compared(&self.map, &self.estimator().ok()?, case)
    }
}

impl PcfCastano {
    /// The estimator, for any layout.
    ///
    /// # Errors
    /// A side that is not 3, 5 or 7.
    pub fn estimator(&self) -> Result<Estimator, GpuError> {
        let side = self.side;
        let Some(core) = castano_core(side) else {
            let fix = "use 3, 5 or 7";
            return Err(GpuError::Invalid { what: "side", value: side.to_string(), fix });
        };
        let constants = source("config", castano_constants(core));
        let kernel = Separable::Castano { side };
        let mut estimator = separable(kernel, "filter::kernel::castano", constants);
        if self.hardware {
            estimator.slots[0] = module("store", "common::compare_map");
            estimator.slots[1] = module("estimator", "filter::hardware_castano");
            estimator.read = MapRead::Comparison;
            estimator.reach = 1.0;
            estimator.fetches /= 4;
        }
        Ok(estimator)
    }
}

impl TechniqueConfig for PcfCastano {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(MapTechnique::new(gpu, &self.map, self.estimator()?)?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        compared(&self.map, &self.estimator().ok()?, case)
    }
}

impl PcfPoisson {
    /// The estimator, for any layout.
    ///
    /// # Errors
    /// A number of taps or a radius out of range.
    pub fn estimator(&self) -> Result<Estimator, GpuError> {
        if !(1..=MAX_TAPS).contains(&self.taps) {
            let fix = "use 1 to 128 taps";
            return Err(GpuError::Invalid { what: "taps", value: self.taps.to_string(), fix });
        }
        check_radius(self.radius)?;
        Ok(Estimator {
            slots: vec![
                module("store", "common::depth_map"),
                module("estimator", "filter::poisson"),
                source("config", poisson_constants(&poisson_disc(self.taps), self.radius)),
            ],
            read: MapRead::Texels,
            radius: self.radius + 0.5,
            reach: 0.0,
            fetches: self.taps,
        })
    }
}

impl TechniqueConfig for PcfPoisson {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(MapTechnique::new(gpu, &self.map, self.estimator()?)?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        compared(&self.map, &self.estimator().ok()?, case)
    }
}

impl PcfCubic {
    /// The estimator, for any layout.
    #[must_use]
    pub fn estimator(&self) -> Estimator {
        separable(Separable::Cubic, "filter::kernel::cubic", source("config", ""))
    }
}

impl TechniqueConfig for PcfCubic {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(MapTechnique::new(gpu, &self.map, self.estimator())?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        compared(&self.map, &self.estimator(), case)
    }
}

impl PcfAdaptive {
    /// The estimator, for any layout.
    ///
    /// # Errors
    /// A side or a radius out of range.
    pub fn estimator(&self) -> Result<Estimator, GpuError> {
        if !(2..=11).contains(&self.side) {
            let fix = "use 2 to 11";
            return Err(GpuError::Invalid { what: "side", value: self.side.to_string(), fix });
        }
        check_radius(self.radius)?;
        let taps = self.side * self.side;
        let probes = if self.exhaustive { taps } else { self.side };
        let constants = poisson_constants(&stratified_disc(self.side), self.radius);
        Ok(Estimator {
            slots: vec![
                module("store", "common::depth_map"),
                module("estimator", "filter::adaptive"),
                source("config", format!("{constants}\nconst PROBES: i32 = {probes};")),
            ],
            read: MapRead::Texels,
            radius: self.radius + 0.5,
            reach: 0.0,
            fetches: taps,
        })
    }
}

impl TechniqueConfig for PcfAdaptive {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(MapTechnique::new(gpu, &self.map, self.estimator()?)?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        let usual = compared(&self.map, &self.estimator().ok()?, case);
        match usual {
            // Probes on the rim that all miss the wire end the search: none of it may be seen.
            Some(Expectation::KnownLimit { at_least, because, .. })
                if case.starts_with("HC-31") =>
            {
                Some(Expectation::KnownLimit { at_least, at_most: 1.0, because })
            }
            _ => usual,
        }
    }
}

fn check_radius(radius: f32) -> Result<(), GpuError> {
    // The kernel's side, 2 radius + 1, has the same limit as the grids.
    if (0.0..=0.5 * (MAX_SIDE - 1) as f32).contains(&radius) {
        return Ok(());
    }
    let fix = "use a radius of 0 to 31 texels";
    Err(GpuError::Invalid { what: "radius", value: radius.to_string(), fix })
}

fn check_side(side: u32) -> Result<u32, GpuError> {
    if (1..=MAX_SIDE).contains(&side) {
        return Ok(side);
    }
    let fix = "use 1 to 63";
    Err(GpuError::Invalid { what: "side", value: side.to_string(), fix })
}

fn side_constant(side: u32) -> Slot {
    source("config", format!("const SIDE: i32 = {side};"))
}

fn separable(kernel: Separable, path: &'static str, constants: Slot) -> Estimator {
    Estimator {
        slots: vec![
            module("store", "common::depth_map"),
            module("estimator", "filter::separable"),
            module("kernel", path),
            constants,
        ],
        read: MapRead::Texels,
        radius: kernel.radius() as f32,
        reach: 0.0,
        fetches: kernel.texels().pow(2),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_range_are_refused_with_a_fix() {
        for side in [0, 64, u32::MAX] {
            assert!(PcfGrid { side, ..Default::default() }.estimator().is_err(), "grid {side}");
            let grid = PcfBilinearGrid { side, ..Default::default() };
            assert!(grid.estimator().is_err(), "bilinear {side}");
        }
        for side in [0, 1, 4, 9] {
            assert!(PcfCastano { side, ..Default::default() }.estimator().is_err(), "side {side}");
        }
        for (taps, radius) in [(0, 1.0), (129, 1.0), (12, -1.0), (12, f32::NAN), (12, 32.0)] {
            let config = PcfPoisson { taps, radius, ..Default::default() };
            assert!(config.estimator().is_err(), "{config:?}");
        }
        for (side, radius) in [(1, 1.0), (12, 1.0), (8, -1.0), (8, f32::NAN), (8, 32.0)] {
            let config = PcfAdaptive { side, radius, ..Default::default() };
            assert!(config.estimator().is_err(), "{config:?}");
        }
    }
}
