//! Translucent surfaces: thin sheets, such as panes of glass, that keep a part of the light and let the rest through.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::Vec2;

use crate::cutout::fault;
use crate::{AlphaMap, Mesh, MeshError};

/// How much of the light a mesh's surface keeps. It is a thin sheet: light that crosses it twice is kept twice, and a body
/// of glass weakens light where it enters and where it leaves. Such meshes are no part of what hides, nor of what a camera
/// sees; their shadows are cast by what looks for them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Opacity {
    /// Texture coordinates of the mesh's vertices, one each. All finite.
    pub uv: Vec<Vec2>,
    /// The texture; meshes may share it.
    pub alpha: Arc<AlphaMap>,
    /// What the texture's alpha, in [0, 1], is multiplied by: finite and at least 0. What is above 1 then counts as 1.
    pub factor: f32,
}

impl Opacity {
    /// The same opacity, in [0, 1], all over a mesh of so many vertices.
    #[must_use]
    pub fn uniform(opacity: f32, vertices: usize) -> Self {
        let alpha = AlphaMap { width: 1, height: 1, texels: vec![255], ..AlphaMap::default() };
        Self { uv: vec![Vec2::ZERO; vertices], alpha: Arc::new(alpha), factor: opacity }
    }

    /// The share of the light that is kept at `uv`, in [0, 1]. The twin of `opacity_at` in `volume/translucent.wesl`.
    #[must_use]
    pub fn at(&self, uv: Vec2) -> f32 {
        (self.factor * (self.alpha.at(uv) / 255.0)).clamp(0.0, 1.0)
    }

    /// Checks that it fits `mesh`, and that its texture is one.
    ///
    /// # Errors
    /// Says what does not fit.
    pub fn validate(&self, mesh: &Mesh) -> Result<(), MeshError> {
        let factor = self.factor.is_finite() && self.factor >= 0.0;
        let factor = (!factor).then_some("needs a factor that is finite and at least 0");
        match fault(&self.uv, &self.alpha, mesh).or(factor) {
            Some(fault) => Err(MeshError::Opacity { mesh: mesh.name.clone(), fault }),
            None => Ok(()),
        }
    }
}

/// The opacities of a scene's translucent meshes, by the meshes' numbers.
pub type Opacities = BTreeMap<usize, Arc<Opacity>>;

/// A translucent mesh among the triangles of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct TranslucentInstance {
    /// The number of the instance, whose triangles are all translucent.
    pub instance: usize,
    /// Its first vertex, which has the first texture coordinates of the opacity.
    pub first_vertex: u32,
    /// How much of the light it keeps.
    pub opacity: Arc<Opacity>,
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn opacity_is_the_factors_part_of_alpha_and_at_most_all() {
        let alpha =
            Arc::new(AlphaMap { width: 1, height: 1, texels: vec![102], ..AlphaMap::default() });
        let at = |factor: f32| {
            Opacity { uv: Vec::new(), alpha: alpha.clone(), factor }.at(Vec2::splat(0.3))
        };
        assert_eq!(
            [at(0.0), at(1.0), at(2.0), at(9.0)],
            [0.0, 0.4, 0.8, 1.0],
            "of an alpha of 0.4"
        );
        assert_eq!(Opacity::uniform(0.5, 3).at(Vec2::ONE), 0.5, "of a uniform one");
    }

    #[test]
    fn what_does_not_fit_is_refused_and_what_does_is_not() {
        let mesh = Mesh { positions: vec![Vec3::ZERO; 3], ..Mesh::default() }.named("pane");
        let whole = Opacity::uniform(0.5, 3);
        assert_eq!(whole.validate(&mesh), Ok(()), "a sound one");
        let broken = [
            Opacity::uniform(0.5, 2),
            Opacity::uniform(f32::NAN, 3),
            Opacity::uniform(-0.5, 3),
            Opacity { uv: vec![Vec2::INFINITY; 3], ..whole.clone() },
            Opacity { alpha: Arc::default(), ..whole },
        ];
        for opacity in broken {
            let fault = opacity.validate(&mesh).expect_err("a fault");
            assert!(fault.to_string().contains("pane"), "{fault}");
        }
    }
}
