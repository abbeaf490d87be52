//! Layered variance shadow maps.

use antumbra_gpu::{Expectation, Gpu, GpuError, Technique, TechniqueConfig};
use antumbra_map::{Estimator, MapConfig, MapTechnique};
use serde::{Deserialize, Serialize};

use crate::expectation::{Bound, expectation};
use crate::prefilter::{Constant, Prefilter, Recipe, check};
use crate::vsm::{U, check_cut};

/// Most layers: a layer costs as much as a variance shadow map.
const MAX_LAYERS: u32 = 16;

/// Layered variance shadow maps (Lauritzen, McCool 2008): a variance shadow map of each of several slices of the
/// depth range, of which a receiver reads its own. Casters in nearer slices all count as at its front and leak
/// nothing between them. 8 bytes a texel and layer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Lvsm {
    /// The shadow map.
    pub map: MapConfig,
    /// The kernel.
    pub filter: Prefilter,
    /// Layers of equal thickness, 1 to 16, default 4. Memory and filtering grow with their number, the lookup
    /// does not.
    pub layers: u32,
    /// Least standard deviation of depth, share of a layer's thickness, 0 to 0.05, default 1e-3. Layers begin 10
    /// of it before they are used: there a fully shadowed receiver gets 1 % of the light.
    pub deviation: f32,
    /// Visibility below which all is dark, what is above being stretched to fill: 0 to 0.99, default 0.
    pub cut: f32,
}

impl Default for Lvsm {
    fn default() -> Self {
        Self {
            map: MapConfig::default(),
            filter: Prefilter::default(),
            layers: 4,
            deviation: 1e-3,
            cut: 0.0,
        }
    }
}

impl Lvsm {
    /// Where each layer begins, in linear depth, and the inverse of its thickness.
    #[must_use]
    pub fn slices(&self) -> Vec<[f64; 2]> {
        let layers = f64::from(self.layers);
        let slice = |i: u32| {
            let start = (f64::from(i) / layers - self.overlap()).max(0.0);
            [start, ((f64::from(i) + 1.0) / layers - start).recip()]
        };
        (0..self.layers).map(slice).collect()
    }

    fn overlap(&self) -> f64 {
        10.0 * f64::from(self.deviation) / f64::from(self.layers)
    }

    fn recipe(&self) -> Result<Recipe, GpuError> {
        self.filter.validate()?;
        if !(1..=MAX_LAYERS).contains(&self.layers) {
            let (what, fix) = ("layers", "use 1 to 16");
            return Err(GpuError::Invalid { what, value: self.layers.to_string(), fix });
        }
        check("deviation", self.deviation, 0.0..=0.05, "use 0 to 0.05 of a layer")?;
        check_cut(self.cut)?;
        // As for one layer, and the slice's own numbers: each is rounded on both sides. A step of depth is as
        // much of a layer, or more.
        let rounding = 0.5 * self.filter.rounding() + 8.0 * U;
        let constants = vec![
            ("LAYERS", Constant::Float(self.layers.into())),
            ("OVERLAP", Constant::Float(self.overlap())),
            ("LEAST_VARIANCE", Constant::Float(f64::from(self.deviation).powi(2))),
            ("CUT", Constant::Float(self.cut.into())),
            ("ROUNDING", Constant::Float(rounding)),
        ];
        let format = wgpu::TextureFormat::Rg32Float;
        let encoding = "filter::encoding::layered";
        let mut recipe = Recipe::new(self.filter, encoding, format, "filter::lvsm", constants);
        recipe.slices = self.slices().iter().map(|[a, b]| [*a as f32, *b as f32]).collect();
        Ok(recipe)
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

impl TechniqueConfig for Lvsm {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(self.technique(gpu)?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        let bound = Bound::Layers { count: self.layers, deviation: self.deviation.into() };
        expectation(&self.map, &self.filter, bound, case)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_range_are_refused_with_a_fix() {
        assert!(Lvsm::default().estimator().is_ok(), "the defaults");
        for config in [
            Lvsm { layers: 0, ..Lvsm::default() },
            Lvsm { layers: 17, ..Lvsm::default() },
            Lvsm { deviation: 0.1, ..Lvsm::default() },
            Lvsm { cut: -0.1, ..Lvsm::default() },
        ] {
            assert!(matches!(config.estimator(), Err(GpuError::Invalid { .. })), "{config:?}");
        }
    }

    #[test]
    fn layers_cover_the_range_and_overlap() {
        for layers in 1..=16 {
            let slices = Lvsm { layers, ..Lvsm::default() }.slices();
            let end = |[start, inverse]: [f64; 2]| start + inverse.recip();
            assert_eq!(slices[0][0], 0.0, "{layers} layers begin");
            assert!((end(slices[slices.len() - 1]) - 1.0).abs() < 1e-12, "{layers} layers end");
            let overlap = |p: &[[f64; 2]]| p[1][0] < end(p[0]) && p[1][0] > p[0][0];
            assert!(slices.windows(2).all(overlap), "{layers} layers: {slices:?}");
        }
    }
}
