//! Variance soft shadow mapping.

use antumbra_gpu::{
    Expectation, Gpu, GpuError, Sat, SatNumbers, SatShader, Technique, TechniqueConfig,
};
use antumbra_map::{Estimator, MapConfig, MapTechnique};
use antumbra_shaders::module;
use serde::{Deserialize, Serialize};

use crate::Facing;
use crate::expectation::{self, Accuracy, HANDED_OVER};
use crate::store::{AreaStore, Beside};
use crate::window::{Hierarchy, Window, check_map};

/// Variance soft shadow mapping (Yang, Dong, Feng, Seidel, Kautz 2010): percentage-closer soft shadows whose two windows, of
/// any size, are read from a table of sums of depth and its square. Takes as long whatever the light's size. 8 bytes a
/// texel beside the map, and 8 for as long as it is made.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Vssm {
    /// The shadow map, which has to hold receivers, too. The cone of its bias counts for one texel.
    pub map: MapConfig,
    /// Finds what is lit, and narrows the search window. Default a mipmap. Costs a pass over the map.
    pub hierarchy: Hierarchy,
    /// Takes a receiver for dark where all texels of its window are nearer. Default true, as published; needs `hierarchy`.
    pub umbra: bool,
    /// Parts a side into which a window is divided whose mean depth is not nearer than the receiver, 1 to 8, default 4. Cost:
    /// 16 fetches each, of up to its square of parts.
    pub parts: u32,
    /// Boxes that stand for a light that is round or seen aslant, 2 to 16, default 8. Cost: 32 fetches each.
    pub strips: u32,
    /// Least standard deviation of depth, share of the depth range, 0 to 1, default 1e-3: hides what rounding does to the
    /// variance.
    pub deviation: f32,
    /// As [`Window::reach`], default 0.
    pub reach: u32,
    /// Counts on the GPU what becomes of samples, for measurements. Default false.
    pub tally: bool,
}

impl Default for Vssm {
    fn default() -> Self {
        Self {
            map: MapConfig::default(),
            hierarchy: Hierarchy::Mip,
            umbra: true,
            parts: 4,
            strips: 8,
            deviation: 1e-3,
            reach: 0,
            tally: false,
        }
    }
}

/// Largest side of a window that is read at once, texels. 14 bits are left for depth.
const MOST: u32 = 511;

impl Vssm {
    fn window(&self) -> Window {
        let Self { hierarchy, umbra, reach, tally, .. } = *self;
        Window { hierarchy, umbra, reach, tally, ..Window::default() }
    }

    /// How the table keeps its sums: as many bits as windows of a map of this side, or of the largest that are read at once,
    /// leave.
    #[must_use]
    pub fn numbers(&self) -> SatNumbers {
        SatNumbers::fixed(self.map.size.clamp(1, MOST) + 1)
    }

    /// # Errors
    /// A setting out of range.
    fn estimator(&self) -> Result<Estimator, GpuError> {
        let invalid = |what, value: String, fix| Err(GpuError::Invalid { what, value, fix });
        if !(1..=8).contains(&self.parts) {
            return invalid("parts", self.parts.to_string(), "use 1 to 8 a side");
        }
        if !(2..=16).contains(&self.strips) {
            return invalid("strips", self.strips.to_string(), "use 2 to 16");
        }
        if !(0.0..=1.0).contains(&self.deviation) {
            let fix = "use 0 to 1 of the depth range";
            return invalid("deviation", self.deviation.to_string(), fix);
        }
        let scale = self.numbers().scale();
        // A value is off by half a step, its mean by no more; 16 windows are rounded to floats, weighted and added, and
        // divided by area and scale; and the receiver's own depth is rounded.
        let rounding = 0.5 / scale + 25.0 * 0.5f64.powi(24);
        let constants = format!(
            "const PARTS: i32 = {};\nconst STRIPS: i32 = {};\nconst LEAST_VARIANCE: f32 = {:?};\n\
             const SCALE: f32 = {:?};\nconst MOST: f32 = {:?};\nconst ROUNDING: f32 = {:?};\n",
            self.parts,
            self.strips,
            self.deviation.powi(2),
            scale as f32,
            MOST as f32,
            rounding as f32,
        );
        // Two windows of a level rectangle; more where they are divided.
        let (store, path) = ("soft::table_map", "soft::vssm");
        Ok(self.window().estimator_over(store, path, Vec::new(), &constants, 32))
    }
}

impl TechniqueConfig for Vssm {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        let estimator = self.estimator()?;
        check_map(&self.map, self.hierarchy)?;
        let sat = Sat::new(
            gpu,
            &SatShader {
                texel: "filter::from_depth",
                slots: vec![module("encoding", "filter::encoding::variance_fixed")],
                channels: 2,
                numbers: self.numbers(),
            },
        )?;
        let beside = Beside { table: Some(sat), ..Beside::default() };
        let store = Box::new(AreaStore::with(gpu, &self.window(), beside)?);
        let arrange = Box::new(Facing { hard: self.map.omni, whole: false });
        Ok(Box::new(MapTechnique::arranged_with_store(gpu, &self.map, estimator, arrange, store)?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        // A cone of one texel moves the receiver nearer by r. Of a share c hidden d before it, the bound leaves
        // (cd - r)^2 / (c (1 - c) d^2 + (cd - r)^2): up to 2 r / d less.
        let size = f64::from(self.map.size);
        let off = |across: f64, d: f64| {
            2.0 * f64::from(self.map.bias.cone) * std::f64::consts::SQRT_2 * across / size / d
        };
        let accuracy = Accuracy {
            apart: off(8.0, 2.0),
            contact: off(1.6, 1.0),
            edge: off(6.0, 5.0),
            cone: 0.0,
            named: self.reach,
            rise: HANDED_OVER,
        };
        expectation::over_a_map(&self.map, &accuracy, case)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_range_are_refused_with_a_fix() {
        for wrong in [
            Vssm { parts: 0, ..Vssm::default() },
            Vssm { parts: 9, ..Vssm::default() },
            Vssm { strips: 1, ..Vssm::default() },
            Vssm { strips: 17, ..Vssm::default() },
            Vssm { deviation: -1.0, ..Vssm::default() },
            Vssm { deviation: f32::NAN, ..Vssm::default() },
        ] {
            assert!(wrong.estimator().is_err(), "{wrong:?}");
        }
        assert!(Vssm::default().estimator().is_ok(), "the defaults");
    }

    #[test]
    fn windows_that_are_read_at_once_fit_the_numbers() {
        // side^2 (2^bits - 1) < 2^32.
        for (size, bits) in [(127, 18), (128, 17), (255, 16), (1024, 14), (8192, 14)] {
            let map = MapConfig { size, ..MapConfig::default() };
            let numbers = Vssm { map, ..Vssm::default() }.numbers();
            assert_eq!(numbers, SatNumbers::Fixed { bits }, "a map of {size}");
        }
    }
}
