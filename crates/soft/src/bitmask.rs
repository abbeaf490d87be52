//! Occlusion bitmasks.

use antumbra_gpu::{Expectation, Gpu, GpuError, Technique, TechniqueConfig};
use antumbra_map::{CasterDepth, Estimator, Faces, MapConfig, MapTechnique, PolygonOffset};
use antumbra_shaders::module;
use serde::{Deserialize, Serialize};

use crate::Facing;
use crate::expectation::{self, Accuracy};
use crate::pcss::build;
use crate::store::AreaStore;
use crate::window::{Window, check_map};

/// How many samples of the light a mask has a bit for: tiles of a rotated grid of four.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Samples {
    /// 4 x 4 tiles.
    S64,
    /// 8 x 8 tiles, as published (default).
    #[default]
    S256,
    /// 16 x 16 tiles.
    S1024,
}

impl Samples {
    /// Tiles a side.
    #[must_use]
    pub fn tiles(self) -> u32 {
        match self {
            Self::S64 => 4,
            Self::S256 => 8,
            Self::S1024 => 16,
        }
    }

    /// Constants of `soft/mask.wesl`: tiles a side, rows of tiles a word, and a 1 at the start of each row.
    #[must_use]
    pub fn constants(self) -> String {
        let (rows, repeat) = match self {
            Self::S64 => (4, 0x1111_u32),
            Self::S256 => (4, 0x0101_0101),
            Self::S1024 => (2, 0x0001_0001),
        };
        let tiles = self.tiles();
        format!(
            "const TILES: i32 = {tiles};\nconst ROWS: i32 = {rows};\nconst REPEAT: u32 = {repeat}u;\n"
        )
    }
}

/// What a small occluder is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Occluders {
    /// A texel as a rectangle parallel to the light. Light leaks between those of a sloping surface.
    Micropatch,
    /// The same, drawn out to its left, lower and diagonal neighbour (Guennebaud, Barthe, Paulin 2006; Bavoil 2008): no
    /// leaks, and no slits where there should be. The default, though microquads are what was published with masks: in
    /// penumbrae of `sphere`, `tree` and `street` the error is 0.49, 0.44 and 0.75 of theirs, for the same time.
    #[default]
    ClosedMicropatch,
    /// Four texel centres as corners, and the rectangle of their means, as published. No leaks; what is one texel wide is
    /// lost.
    Microquad,
    /// Four texel centres, and exactly what they hide (Schwarz, Stamminger 2008). One to `tiles` turns of a loop for each of two
    /// triangles: with a `budget` above 64 Mesa's software device may end it early.
    ExactMicroquad,
    /// The same, and three texel centres where the fourth is missing.
    Microtri,
}

impl Occluders {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Micropatch,
        Self::ClosedMicropatch,
        Self::Microquad,
        Self::ExactMicroquad,
        Self::Microtri,
    ];

    pub(crate) fn is_quad(self) -> bool {
        !matches!(self, Self::Micropatch | Self::ClosedMicropatch)
    }

    fn constants(self) -> String {
        let close = self == Self::ClosedMicropatch;
        let exact = matches!(self, Self::ExactMicroquad | Self::Microtri);
        let tris = self == Self::Microtri;
        format!(
            "const CLOSE: bool = {close};\nconst EXACT: bool = {exact};\nconst TRIS: bool = {tris};\n"
        )
    }
}

/// Bitmask soft shadows (Schwarz, Stamminger 2007): a bit for each sample of the light, set by whatever hides it, so that
/// occluders are joined as they should be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Bitmask {
    /// The shadow map.
    pub map: MapConfig,
    /// The search for occluders. Cost: one to four fetches and some 100 integer operations a texel of the window.
    pub window: Window,
    /// Samples of the light, default 256. Cost: in proportion, a texel's operations.
    pub samples: Samples,
    /// What occludes, default micropatches without gaps.
    pub occluders: Occluders,
    /// Surfaces along each ray from the light's centre that occlude, 1 to 4, default 1: what lies behind the first hides other
    /// parts of the light. Cost: each a pass over the casters' triangles, which have to be known, and as many fetches as the
    /// first; 4 bytes a texel.
    pub layers: u32,
}

impl Default for Bitmask {
    fn default() -> Self {
        Self {
            map: MapConfig::default(),
            window: Window::default(),
            samples: Samples::default(),
            occluders: Occluders::default(),
            layers: 1,
        }
    }
}

impl Bitmask {
    fn estimator(&self) -> Result<Estimator, GpuError> {
        if !(1..=4).contains(&self.layers) {
            let (what, fix) = ("layers", "use 1 to 4");
            return Err(GpuError::Invalid { what, value: self.layers.to_string(), fix });
        }
        let quad = self.occluders.is_quad();
        let path = if quad { "soft::microquad" } else { "soft::micropatch" };
        let constants = self.samples.constants()
            + &self.occluders.constants()
            + &format!("const DEEPER: i32 = {};\n", self.layers - 1);
        let texels = match self.occluders {
            Occluders::Micropatch => 1,
            _ => 4,
        };
        let fetches = self.window.budget.saturating_pow(2).saturating_mul(texels * self.layers);
        let mut slots = vec![module("occluders", path)];
        if self.layers == 1 {
            slots.push(module("soft::deeper", "soft::no_deeper"));
        }
        Ok(self.window.estimator("soft::bitmask", slots, &constants, fetches))
    }
}

impl TechniqueConfig for Bitmask {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        let estimator = self.estimator()?;
        if self.layers == 1 {
            return build(gpu, &self.map, estimator, &self.window);
        }
        check_map(&self.map, self.window.hierarchy)?;
        let store = Box::new(AreaStore::with(gpu, &self.window, None, self.layers)?);
        let arrange = Box::new(Facing { hard: self.map.omni, whole: false });
        // Peeling finds the depths of the first layer again, from the same triangles.
        let first = CasterDepth::new(gpu, Faces::Both, PolygonOffset::default())?;
        let map = MapTechnique::arranged_with_store(gpu, &self.map, estimator, arrange, store)?;
        Ok(Box::new(map.drawn_by(first)))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        // An edge that runs along the samples' rows is off by half of one of 4 a tile; two an axis.
        let edge = 0.5 / f64::from(4 * self.samples.tiles());
        let accuracy = Accuracy {
            apart: 4.0 * edge,
            contact: edge,
            edge: 2.0 * edge,
            ..Accuracy::of(&self.map)
        };
        expectation::over_a_map(&self.map, &accuracy, case)
    }
}
