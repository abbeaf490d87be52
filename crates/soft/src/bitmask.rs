//! Occlusion bitmasks.

use antumbra_gpu::{Expectation, Gpu, GpuError, Technique, TechniqueConfig};
use antumbra_map::{CasterDepth, Estimator, Faces, MapConfig, MapTechnique, PolygonOffset};
use antumbra_scene::Emission;
use antumbra_shaders::module;
use serde::{Deserialize, Serialize};

use crate::Facing;
use crate::expectation::{self, Accuracy};
use crate::pattern::{Pattern, PatternTables};
use crate::split::Split;
use crate::store::{AreaStore, Beside};
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

    /// Cells a side of which each has one sample: of the four in a tile one lies in each quarter of it.
    pub(crate) fn cells(self) -> u32 {
        2 * self.tiles()
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

    /// Whether triangles are marked, as opposed to rectangles.
    fn is_exact(self) -> bool {
        matches!(self, Self::ExactMicroquad | Self::Microtri)
    }

    fn module(self) -> &'static str {
        match self {
            Self::Micropatch | Self::ClosedMicropatch => "soft::micropatch",
            Self::Microquad => "soft::microquad",
            Self::ExactMicroquad | Self::Microtri => "soft::exact_microquad",
        }
    }

    fn constants(self) -> String {
        let close = self == Self::ClosedMicropatch;
        let tris = self == Self::Microtri;
        format!("const CLOSE: bool = {close};\nconst TRIS: bool = {tris};\n")
    }
}

/// Bitmask soft shadows (Schwarz, Stamminger 2007): a bit for each sample of the light, set by whatever hides it, so that
/// occluders are joined as they should be.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Bitmask {
    /// The shadow map.
    pub map: MapConfig,
    /// The search for occluders. Cost: one to four fetches and some 100 integer operations a texel of the window.
    pub window: Window,
    /// Samples of the light, default 256. Cost: in proportion, a texel's operations.
    pub samples: Samples,
    /// Where they lie, default tiles of a rotated grid of four. Cost of others: 16 fetches or more a texel from a table of 20 to
    /// 300 KiB, in place of operations; for rectangles only.
    pub pattern: Pattern,
    /// What occludes, default micropatches without gaps.
    pub occluders: Occluders,
    /// Surfaces along each ray from the light's centre that occlude, 1 to 4, default 1: what lies behind the first hides other
    /// parts of the light. Cost: each a pass over the casters' triangles, which have to be known, and as many fetches as the
    /// first; 4 bytes a texel.
    pub layers: u32,
    /// What a rectangle or a disc emits from place to place, default alike everywhere: visibility is then the share of what it
    /// emits that is seen (Forest, Barthe, Paulin 2008). As fine as samples lie: 8, 16 or 32 cells a side, each the mean of what
    /// is given. A coloured light has a channel each. Cost: samples one by one in place of counting them.
    pub emission: Option<Emission>,
    /// Parts along the two sides of a rectangle of light, 1 to 8 each, default 1, each with maps of its own from its centre: what
    /// one part's centre does not see, another's may (Assarsson et al. 2003; Yang et al. 2009). Cost: each part all that the
    /// light costs, and 4 bytes a view sample. Other lights are not cut.
    pub parts: [u32; 2],
}

impl Default for Bitmask {
    fn default() -> Self {
        Self {
            map: MapConfig::default(),
            window: Window::default(),
            samples: Samples::default(),
            pattern: Pattern::default(),
            occluders: Occluders::default(),
            layers: 1,
            emission: None,
            parts: [1, 1],
        }
    }
}

impl Bitmask {
    /// The tables of a pattern that needs some.
    fn tables(&self) -> Result<Option<PatternTables>, GpuError> {
        if self.occluders.is_exact() && self.pattern != Pattern::Tiles {
            let value = "triangles over a pattern of samples".to_owned();
            let fix =
                "use micropatches or microquads, which mark rectangles, or the pattern of tiles";
            return Err(GpuError::Invalid { what: "occluders", value, fix });
        }
        if self.window.reach > 0 && self.pattern != Pattern::Tiles {
            let value = format!("{} over a pattern of samples", self.window.reach);
            let fix = "leave `reach` at 0, or use the pattern of tiles";
            return Err(GpuError::Invalid { what: "window.reach", value, fix });
        }
        self.pattern.tables(self.samples)
    }

    /// Cells a side of which each has some one sample.
    fn cells(&self) -> u32 {
        match &self.pattern {
            Pattern::Points(points) => points.len().isqrt().max(1) as u32,
            _ => self.samples.cells(),
        }
    }

    fn estimator(&self, tables: Option<&PatternTables>) -> Result<Estimator, GpuError> {
        if !(1..=4).contains(&self.layers) {
            let (what, fix) = ("layers", "use 1 to 4");
            return Err(GpuError::Invalid { what, value: self.layers.to_string(), fix });
        }
        let constants = self.samples.constants()
            + &self.occluders.constants()
            + &format!("const DEEPER: i32 = {};\n", self.layers - 1)
            + &format!("const EMISSION: i32 = {};\n", self.cells())
            + tables.map_or("", |tables| &tables.constants);
        let texels = match self.occluders {
            Occluders::Micropatch => 1,
            _ => 4,
        };
        let fetches = self.window.budget.saturating_pow(2).saturating_mul(texels * self.layers);
        let mut slots = vec![module("occluders", self.occluders.module())];
        if self.layers == 1 {
            slots.push(module("soft::deeper", "soft::no_deeper"));
        }
        if tables.is_some() {
            slots.push(module("soft::mask", "soft::pattern_mask"));
        }
        if self.emission.is_some() {
            slots.push(module("soft::counted", "soft::emitted"));
        }
        let (store, path) = ("common::depth_map", "soft::bitmask");
        Ok(self.window.masking_estimator(store, path, slots, &constants, fetches))
    }
}

impl Bitmask {
    /// Of a light that is not cut, or of one part.
    fn whole(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        let tables = self.tables()?;
        let estimator = self.estimator(tables.as_ref())?;
        check_map(&self.map, self.window.hierarchy)?;
        let emission: Option<Vec<f32>> = self.emission.as_ref().map(|emission| {
            let means = emission.means(self.cells());
            means.into_iter().map(|mean| mean as f32).collect()
        });
        let beside = Beside {
            layers: self.layers,
            emission: emission.as_deref(),
            pattern: tables.as_ref().map(|tables| &tables.data[..]),
            ..Beside::default()
        };
        let store = Box::new(AreaStore::with(gpu, &self.window, beside)?);
        let arrange = Box::new(Facing { hard: self.map.omni, whole: false });
        let map = MapTechnique::arranged_with_store(gpu, &self.map, estimator, arrange, store)?;
        if self.layers == 1 {
            return Ok(Box::new(map));
        }
        // Peeling finds the depths of the first layer again, from the same triangles.
        let first = CasterDepth::new(gpu, Faces::Both, PolygonOffset::default())?;
        Ok(Box::new(map.drawn_by(first)))
    }

    /// # Errors
    /// Too many parts, or an image, which lies on the light as a whole.
    fn check_parts(&self) -> Result<(), GpuError> {
        let [across, along] = self.parts;
        let invalid = |value: String, fix| Err(GpuError::Invalid { what: "parts", value, fix });
        if !self.parts.iter().all(|count| (1..=8).contains(count)) {
            return invalid(format!("{across} x {along}"), "use 1 to 8 a side");
        }
        if self.emission.is_some() && self.parts != [1, 1] {
            let value = format!("{across} x {along} of a light with an image");
            return invalid(value, "leave `parts` at 1 x 1, or `emission` out");
        }
        Ok(())
    }
}

impl TechniqueConfig for Bitmask {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        self.check_parts()?;
        if self.parts == [1, 1] {
            return self.whole(gpu);
        }
        Ok(Box::new(Split::new(gpu, self.parts, || self.whole(gpu))?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        let edge = match self.pattern {
            // An edge that runs along the samples' rows is off by half of one of 4 a tile; two an axis.
            Pattern::Tiles => 0.5 / f64::from(4 * self.samples.tiles()),
            // A row of cells, of which each has one.
            Pattern::Jittered | Pattern::Hammersley | Pattern::Poisson => {
                1.0 / f64::from(self.cells())
            }
            Pattern::Points(_) => return None,
        };
        if self.layers > 1
            && let Some(whole) = antumbra_map::without_holes(case)
        {
            return Some(whole);
        }
        let accuracy = Accuracy {
            apart: 4.0 * edge,
            contact: edge,
            edge: 2.0 * edge,
            named: self.window.reach,
            ..Accuracy::of(&self.map)
        };
        expectation::over_a_map(&self.map, &accuracy, case)
    }
}
