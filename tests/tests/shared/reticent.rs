//! Casters that keep their triangles to themselves.

use antumbra_gpu::{Casters, Drawn, LightView};
use antumbra_scene::Light;
use glam::DVec3;

/// What others draw, and no more said of it.
pub(crate) struct Reticent<'a>(pub(crate) &'a dyn Casters);

impl Casters for Reticent<'_> {
    fn hull(&self, light: &Light, visit: &mut dyn FnMut(DVec3)) {
        self.0.hull(light, visit);
    }

    fn draw(&self, view: &LightView<'_>, pass: &mut wgpu::RenderPass<'_>) -> Drawn {
        self.0.draw(view, pass)
    }
}
