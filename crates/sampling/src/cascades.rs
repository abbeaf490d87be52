//! Cascaded shadow maps: the view's depth range in slices, one map each.

use antumbra_gpu::{Expectation, Frame, Gpu, GpuError, Technique, TechniqueConfig, check_light};
use antumbra_map::{Arrange, Drawing, Fitting, Layout, Plain, SeenView, Sight, fit_seen};
use antumbra_scene::Light;
use antumbra_shaders::{module, source};
use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::cascade_fit::{Slices, no_view};
use crate::{Eye, Splits, over_map};

/// Which cascade answers for a point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Select {
    /// The finest that holds it (Zhang et al. 2009). Never coarser than by depth; costs up to one matrix a cascade.
    #[default]
    Map,
    /// That of the slice it is in (Zhang et al. 2006). Draws fewer casters.
    Depth,
}

/// What a cascade's window is fitted to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CascadeFit {
    /// The sphere around its slice, no wider than what casts on something (Valient 2008). Its scale does not change
    /// when the camera turns, and it moves in whole texels: shadows stand still.
    #[default]
    Steady,
    /// What is visible in its slice: about half the area, but the scale changes with the view, in steps of 9 %.
    Tight,
    /// As tight, and warped towards the eye (Lloyd et al. 2006) where that makes texels smaller. Swims when the
    /// camera moves.
    Warped,
}

/// Cascaded, or parallel-split, shadow maps (Engel 2006; Zhang et al. 2006; Lloyd et al. 2006): the view's depth range
/// is cut into slices, and each gets a map of its own. Serves directional light; under other lights, and where there
/// is no camera, everything is as without cascades.
///
/// What is looked up, and how, is another technique's affair: any over a shadow map.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Cascades<E = Plain> {
    /// The technique over the maps, by default the plain test. All its settings hold for each cascade.
    pub of: E,
    /// Number of cascades, 1 to 8, default 4. Memory and depth passes grow with it. With logarithmic splits of depths
    /// in the ratio q a picture needs `count` q^(1/`count`) (q^(1/`count`) - 1) texels a pixel.
    pub count: u32,
    /// Where slices end.
    pub splits: Splits,
    /// Which cascade answers.
    pub select: Select,
    /// Share of a cascade at its end over which it hands over to the next, 0 to 0.5, default 0.1: of a slice's depth,
    /// or of a map's half width. Two lookups there instead of one.
    pub blend: f32,
    /// What windows are fitted to.
    pub fit: CascadeFit,
}

/// The most cascades: beyond it the gain is below what one texel more or less does.
const MOST: u32 = 8;

impl<E: Default> Default for Cascades<E> {
    fn default() -> Self {
        Self {
            of: E::default(),
            count: 4,
            splits: Splits::default(),
            select: Select::default(),
            blend: 0.1,
            fit: CascadeFit::default(),
        }
    }
}

impl<E> Cascades<E> {
    /// Fits by cascades what is lit directionally, and everything else by `others`.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn arrange(&self, others: Box<dyn Arrange>) -> Result<Box<dyn Arrange>, GpuError> {
        if !(1..=MOST).contains(&self.count) {
            let fix = "use 1 to 8";
            let value = self.count.to_string();
            return Err(GpuError::Invalid { what: "number of cascades", value, fix });
        }
        if !(0.0..=0.5).contains(&self.blend) {
            let fix = "use 0 to 0.5 of a cascade";
            return Err(GpuError::Invalid { what: "blend", value: self.blend.to_string(), fix });
        }
        self.splits.validate()?;
        let Self { of: _, count, splits, select, blend, fit } = *self;
        let settings = Cascades { of: (), count, splits, select, blend, fit };
        Ok(Box::new(Cascading { settings, others }))
    }
}

impl<E: TechniqueConfig> TechniqueConfig for Cascades<E> {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        over_map(gpu, &self.of, |others| self.arrange(others))
    }

    fn set_map_size(&mut self, size: u32) {
        self.of.set_map_size(size);
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        // Windows are no wider than that around all casters, which the cases' bounds are derived for.
        self.of.expectation(case)
    }
}

/// The arrangement of cascades.
#[derive(Debug)]
struct Cascading {
    settings: Cascades<()>,
    others: Box<dyn Arrange>,
}

impl Cascading {
    /// Views of the layout that are none, after the cascades'.
    fn tail(&self) -> usize {
        match self.settings.select {
            Select::Map => 1,
            Select::Depth => self.settings.count as usize,
        }
    }
}

impl Arrange for Cascading {
    fn layout(&self, light: &Light) -> Layout {
        if !matches!(light, Light::Directional { .. }) {
            return self.others.layout(light);
        }
        let select = match self.settings.select {
            Select::Map => "sampling::cascade_by_map",
            Select::Depth => "sampling::cascade_by_depth",
        };
        let count = self.settings.count;
        Layout {
            slots: vec![
                module("layout", select),
                module("map::shadow", "sampling::cascade_shadow"),
                module("map::looked_up", "sampling::cascade_looked_up"),
                source("cascades", format!("const CASCADES: i32 = {count};")),
            ],
            views: count as usize + self.tail(),
            drawing: Drawing::Matrix,
        }
    }

    fn fit(
        &self,
        frame: &Frame<'_>,
        hull: &[DVec3],
        sight: Option<&Sight<'_>>,
        fitting: &Fitting,
    ) -> Result<Vec<SeenView>, GpuError> {
        if !matches!(frame.light, Light::Directional { .. }) {
            return self.others.fit(frame, hull, sight, fitting);
        }
        check_light(frame.light)?;
        let count = self.settings.count as usize;
        let eye = frame.camera.as_ref().and_then(Eye::new);
        // On a map that the kernel fills there is nothing to share out.
        let seen = eye.zip(sight).filter(|_| fitting.usable() >= 1.0);
        let spread = self.others.spread(frame.light);
        let slices = seen.and_then(|(eye, sight)| {
            Slices::new(&self.settings, frame, hull, eye, sight, fitting, spread)
        });
        let (mut views, ends) = match slices {
            Some(slices) => (slices.views(), slices.ends()),
            None => {
                // All of it in the first.
                let mut views = fit_seen(frame.light, hull, sight, fitting)?;
                let light = views[0].view.light;
                views.resize(count, no_view(light));
                let first = match self.settings.select {
                    Select::Map => DVec3::new(1.0, f64::from(f32::MAX), 0.0).extend(0.0),
                    Select::Depth => DVec3::ZERO.extend(2.0),
                };
                (views, vec![first; self.tail()])
            }
        };
        views.extend(ends.into_iter().map(no_view));
        Ok(views)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_range_are_refused_with_a_fix() {
        let plain = Cascades::<Plain>::default();
        let others = || Box::new(antumbra_map::Omni::Cube);
        assert!(plain.arrange(others()).is_ok(), "the defaults");
        for config in [
            Cascades { count: 0, ..plain },
            Cascades { count: 9, ..plain },
            Cascades { blend: 0.6, ..plain },
            Cascades { blend: f32::NAN, ..plain },
            Cascades { splits: Splits::Practical { weight: 2.0 }, ..plain },
        ] {
            let refused = config.arrange(others());
            assert!(matches!(refused, Err(GpuError::Invalid { .. })), "{config:?}");
        }
    }
}
