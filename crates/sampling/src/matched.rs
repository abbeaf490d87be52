//! Resolution-matched shadow maps: pages of a virtual map, as fine as the view asks for and no finer.

mod expectation;
mod pages;
mod passes;
mod room;
pub mod twin;
mod window;

use std::any::Any;
use std::cell::Cell;

use antumbra_gpu::{Expectation, Frame, Gpu, GpuError, Technique, TechniqueConfig, check_light};
use antumbra_map::{
    Arrange, Drawing, Fitting, Layout, MapTechnique, Plain, Refit, SeenView, Sight,
};
use antumbra_scene::Light;
use antumbra_shaders::module;
use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::over::map_technique;
pub use pages::{MatchedPages, Request};
pub use twin::{Page, Virtual};
pub use window::{Standing, windows};

/// Resolution-matched shadow maps (Lefohn, Sengupta, Owens 2007): each view sample asks for the page of a quadtree whose
/// texels put edges where they belong to within a part of its pixel; only pages that are asked for are drawn, and they are
/// kept until light or casters move, wherever the camera goes. Lights that shine all around have a quadtree on each face
/// of a cube.
///
/// What is looked up in the pages, and how, is another technique's affair: any over a shadow map whose kernel is bounded.
/// Its kernel counts texels of the page's level, and so has the size on the screen that matched texels have.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ResolutionMatched<E = Plain> {
    /// The technique over the pages, by default the plain test. Its map, whose size is usually 2048 texels a side, is the
    /// atlas that holds them. Where the pages that are asked for do not fit, those of the finest levels become coarser, of
    /// as few levels as will do, and there those that the fewest samples look at.
    pub of: E,
    /// Side of a page, texels, borders for the kernel included: a power of two, 1 to 1024, default 64. It is made smaller
    /// where the atlas would be less than 16 pages wide, and larger where it would be more than 64 or a border took more
    /// than an eighth of it. Small pages waste less of the atlas and cost more draws.
    pub page: u32,
    /// Pages a side of the finest level: a power of two, 1 to 1024, default 256. With `page` the resolution at which
    /// requests end: some 15 000 texels across all casters by default. Memory: 27 bytes times its square, for each face
    /// of a cube.
    pub table: u32,
    /// Pixels by which a shadow's edge may be displaced: above 0, to 64, default 0.125. Of the samples 0.18 times as many are
    /// wrong, on average, for each pixel of edge a pixel: at 0.125 one in 200 where an edge crosses every fourth pixel. Half of
    /// it takes up to four times the pages, and leaves half of the error.
    pub displacement: f32,
}

/// What tests withhold from a technique.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Pairs of page and triangle that there is room for at most, 1 or more, as on a device with small buffers. Pages whose
    /// lists have no room are drawn from all casters.
    pub pairs: u32,
    /// Widest border of a page, texels. Kernels that reach beyond it read what lies beside the page in the atlas.
    pub border: u32,
}

impl Default for Limits {
    fn default() -> Self {
        Self { pairs: u32::MAX, border: u32::MAX }
    }
}

/// The guard band of a test of one texel, which needs no border.
const NO_KERNEL: u32 = 2;

impl<E: Default> Default for ResolutionMatched<E> {
    fn default() -> Self {
        Self { of: E::default(), page: 64, table: 256, displacement: 0.125 }
    }
}

impl<E> ResolutionMatched<E> {
    /// The virtual map of these settings, in an atlas of `size` texels a side, for a kernel that reaches less than `border`
    /// texels.
    ///
    /// # Errors
    /// A setting out of range, or an atlas that is too small for a page.
    pub fn layout(&self, size: u32, border: u32) -> Result<Virtual, GpuError> {
        let invalid = |what, value: String, fix| Err(GpuError::Invalid { what, value, fix });
        if !(self.page.is_power_of_two() && self.page <= 1024) {
            let fix = "use a power of two from 1 to 1024";
            return invalid("side of a page", self.page.to_string(), fix);
        }
        if !(self.table.is_power_of_two() && self.table <= 1024) {
            let fix = "use a power of two from 1 to 1024";
            return invalid("pages a side", self.table.to_string(), fix);
        }
        if !(self.displacement > 0.0 && self.displacement <= 64.0) {
            let fix = "use more than 0 and at most 64 pixels; 0.5 keeps edges within their pixel";
            return invalid("displacement", self.displacement.to_string(), fix);
        }
        let most = 1 << (size / 16).max(1).ilog2();
        let least = size.div_ceil(64).max(8 * border).next_power_of_two();
        let (mut page, mut border) = (self.page.min(most).max(least), border);
        // Room for a page of each face of a cube.
        if 3 * page > size {
            if border > NO_KERNEL {
                let fix =
                    "use a map of at least 24 texels a side for each texel of the kernel's radius";
                return invalid("atlas of pages", size.to_string(), fix);
            }
            (page, border) = (1 << (size / 3).max(1).ilog2(), 0);
        }
        let (table, rule) = (self.table, self.displacement);
        Ok(Virtual { page, border, table, row: size / page, rule })
    }

    fn settings(&self) -> ResolutionMatched<()> {
        let Self { of: _, page, table, displacement } = *self;
        ResolutionMatched { of: (), page, table, displacement }
    }
}

impl<E: TechniqueConfig> ResolutionMatched<E> {
    /// As [`TechniqueConfig::build`], within limits: for tests.
    ///
    /// # Errors
    /// As [`TechniqueConfig::build`].
    pub fn build_within(&self, gpu: &Gpu, limits: Limits) -> Result<Box<dyn Technique>, GpuError> {
        let settings = self.settings();
        // Any atlas and kernel: the settings' own ranges.
        settings.layout(1 << 12, 1)?;
        let technique = map_technique(gpu, &self.of)?;
        if !technique.is_local() {
            return Err(GpuError::Invalid {
                what: "technique `of`",
                value: "one that draws its map itself or looks farther than a kernel".to_owned(),
                fix: "choose map/plain or one of filter/ over pages; for soft shadows use sampling/cascades",
            });
        }
        let arrange = Box::new(Paging { settings, limits, standing: Cell::default() });
        Ok(Box::new(technique.rearranged(|_| Ok(arrange))?))
    }
}

impl<E: TechniqueConfig> TechniqueConfig for ResolutionMatched<E> {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        self.build_within(gpu, Limits::default())
    }

    fn set_map_size(&mut self, size: u32) {
        self.of.set_map_size(size);
    }

    fn map_size(&self) -> Option<u32> {
        self.of.map_size()
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        let size = self.of.map_size();
        expectation::matched(&self.settings(), size, self.of.expectation(case), case)
    }
}

/// The pages of a technique that [`ResolutionMatched`] built, once it was prepared.
#[must_use]
pub fn pages_of(technique: &dyn Technique) -> Option<&MatchedPages> {
    let technique: &dyn Any = technique;
    let refit: &dyn Any = technique.downcast_ref::<MapTechnique>()?.refit()?;
    refit.downcast_ref()
}

/// The arrangement: the windows that the pages divide.
#[derive(Debug)]
struct Paging {
    settings: ResolutionMatched<()>,
    limits: Limits,
    standing: Cell<Standing>,
}

impl Paging {
    fn select(light: &Light) -> (&'static str, usize) {
        match light {
            Light::Directional { .. } | Light::Spot { .. } => ("map::layout_single", 1),
            _ => ("map::layout_cube", 6),
        }
    }
}

impl Arrange for Paging {
    fn layout(&self, light: &Light) -> Layout {
        let (select, views) = Self::select(light);
        Layout {
            slots: vec![
                module("layout", select),
                module("map::shadow", "sampling::matched_shadow"),
            ],
            views,
            drawing: Drawing::Pages,
        }
    }

    /// Whatever the camera sees: pages are to last until it sees something else.
    fn fit(
        &self,
        frame: &Frame<'_>,
        hull: &[DVec3],
        _: Option<&Sight<'_>>,
        fitting: &Fitting,
    ) -> Result<Vec<SeenView>, GpuError> {
        check_light(frame.light)?;
        let map = self.settings.layout(fitting.size, fitting.guard.min(self.limits.border))?;
        let (texels, mut standing) = (map.texels(), self.standing.get());
        let receivers = fitting.receivers;
        let views = windows(frame.light, hull, frame.origin, texels, receivers, &mut standing);
        self.standing.set(standing);
        Ok(views)
    }

    fn refit(&self, gpu: &Gpu, light: &Light) -> Result<Option<Box<dyn Refit>>, GpuError> {
        let (select, faces) = Self::select(light);
        let pages = MatchedPages::new(gpu, self.settings, self.limits, (select, faces as u32))?;
        Ok(Some(Box::new(pages)))
    }
}
