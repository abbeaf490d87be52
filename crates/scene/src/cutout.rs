//! Surfaces with holes: alpha textures that say how much of a mesh is there.
//!
//! A cut-out is geometry. A point of a triangle is there where the interpolated alpha at its texture coordinates reaches
//! a cutoff, whoever asks and from however far: no smaller copies of the texture are made, whose averages would let
//! shadows grow or thin out with distance. So shadow maps, view samples and ray tracer agree on where the surface ends.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::Vec2;

use crate::{Mesh, MeshError};

/// What lies beyond the border of a texture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wrap {
    /// The texture again.
    #[default]
    Repeat,
    /// Its border's texels.
    Clamp,
    /// The texture again, every other time mirrored.
    Mirror,
}

impl Wrap {
    /// The texel, of `count`, that stands for the one at `i`.
    fn index(self, i: i32, count: i32) -> i32 {
        match self {
            Self::Repeat => i.rem_euclid(count),
            Self::Clamp => i.clamp(0, count - 1),
            Self::Mirror => {
                let i = i.rem_euclid(2 * count);
                i.min(2 * count - 1 - i)
            }
        }
    }
}

/// A texture of alpha.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AlphaMap {
    /// Texels a row, in 1..=[`AlphaMap::LARGEST`].
    pub width: u32,
    /// Rows, in 1..=[`AlphaMap::LARGEST`].
    pub height: u32,
    /// Alpha in 1/255, row by row from v = 0.
    pub texels: Vec<u8>,
    /// What lies beyond the border, along u and along v.
    pub wrap: [Wrap; 2],
    /// Whether alpha between the texels' centres is that of the nearest texel instead of a bilinear mean of four.
    pub nearest: bool,
}

impl AlphaMap {
    /// Largest side, texels.
    pub const LARGEST: u32 = 1 << 14;

    /// Alpha at the texture coordinates `uv` (u to the right, v down; the texture spans [0, 1]), in 1/255. The twin of
    /// `alpha_at` in `gpu/cutout.wesl`: the same operations on `f32`.
    #[must_use]
    pub fn at(&self, uv: Vec2) -> f32 {
        let place = uv * Vec2::new(self.width as f32, self.height as f32);
        if self.nearest {
            let texel = place.floor();
            return self.texel(texel.x as i32, texel.y as i32);
        }
        let place = place - Vec2::splat(0.5);
        let low = place.floor();
        let part = place - low;
        let (x, y) = (low.x as i32, low.y as i32);
        // Equal neighbours give themselves exactly in this form.
        let between = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let row = |y: i32| between(self.texel(x, y), self.texel(x.saturating_add(1), y), part.x);
        between(row(y), row(y.saturating_add(1)), part.y)
    }

    /// Whether its sides are in range and it has as many texels as they make.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let side = 1..=Self::LARGEST;
        side.contains(&self.width)
            && side.contains(&self.height)
            && self.texels.len() == self.width as usize * self.height as usize
    }

    fn texel(&self, x: i32, y: i32) -> f32 {
        let x = self.wrap[0].index(x, self.width as i32);
        let y = self.wrap[1].index(y, self.height as i32);
        f32::from(self.texels[y as usize * self.width as usize + x as usize])
    }
}

/// What of a mesh is there.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cutout {
    /// Texture coordinates of the mesh's vertices, one each. All finite.
    pub uv: Vec<Vec2>,
    /// The texture; meshes may share it.
    pub alpha: Arc<AlphaMap>,
    /// The least alpha of what is there, in 1/255: 127.5 by the usual convention of one half. Of 0 or less, all is.
    pub cutoff: f32,
}

impl Cutout {
    /// Whether the surface is there at `uv`.
    #[must_use]
    pub fn is_there(&self, uv: Vec2) -> bool {
        self.alpha.at(uv) >= self.cutoff
    }

    /// Checks that it fits `mesh`, and that its texture is one.
    ///
    /// # Errors
    /// Says what does not fit.
    pub fn validate(&self, mesh: &Mesh) -> Result<(), MeshError> {
        let cutoff = (!self.cutoff.is_finite()).then_some("has a cutoff that is not finite");
        match fault(&self.uv, &self.alpha, mesh).or(cutoff) {
            Some(fault) => Err(MeshError::Cutout { mesh: mesh.name.clone(), fault }),
            None => Ok(()),
        }
    }
}

/// What is wrong with a texture on a mesh.
pub(crate) fn fault(uv: &[Vec2], alpha: &AlphaMap, mesh: &Mesh) -> Option<&'static str> {
    if uv.len() != mesh.positions.len() {
        Some("needs as many texture coordinates as the mesh has vertices")
    } else if !uv.iter().all(|uv| uv.is_finite()) {
        Some("has texture coordinates that are not finite")
    } else if !alpha.is_valid() {
        Some("needs a texture of 1 to 16384 texels a side, and as many texels as that makes")
    } else {
        None
    }
}

/// The cut-outs of a scene's meshes, by the meshes' numbers.
pub type Cutouts = BTreeMap<usize, Arc<Cutout>>;

/// A cut-out among the triangles of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct CutInstance {
    /// The number of the instance, whose triangles are all cut.
    pub instance: usize,
    /// Its first vertex, which has the first texture coordinates of the cut-out.
    pub first_vertex: u32,
    /// What of it is there.
    pub cutout: Arc<Cutout>,
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    fn map(wrap: Wrap, nearest: bool) -> AlphaMap {
        AlphaMap { width: 2, height: 1, texels: vec![0, 200], wrap: [wrap; 2], nearest }
    }

    #[test]
    fn alpha_is_that_of_the_texels_at_their_centres_and_between_them_in_proportion() {
        let at = |u: f32| map(Wrap::Clamp, false).at(Vec2::new(u, 0.3));
        assert_eq!([at(0.25), at(0.375), at(0.5), at(0.75)], [0.0, 50.0, 100.0, 200.0], "between");
        assert_eq!([at(-3.0), at(4.0)], [0.0, 200.0], "beyond the border");
        let nearest = |u: f32| map(Wrap::Clamp, true).at(Vec2::new(u, 0.3));
        assert_eq!([nearest(0.499), nearest(0.501)], [0.0, 200.0], "nearest");
    }

    #[test]
    fn beyond_the_border_the_texture_goes_on_as_asked() {
        let at = |wrap, u: f32| map(wrap, false).at(Vec2::new(u, 0.5));
        for u in [-1.75_f32, -0.75, 1.25] {
            assert_eq!(at(Wrap::Repeat, u), 0.0, "repeated at {u}");
        }
        // At the seam the last and the first texel meet.
        assert_eq!(at(Wrap::Repeat, 1.0), 100.0, "repeated at the seam");
        assert_eq!([at(Wrap::Mirror, 1.0), at(Wrap::Mirror, 1.25)], [200.0, 200.0], "mirrored");
        assert_eq!([at(Wrap::Mirror, -0.25), at(Wrap::Mirror, 1.75)], [0.0, 0.0], "mirrored");
    }

    #[test]
    fn what_does_not_fit_is_refused_and_what_does_is_not() {
        let mesh = Mesh { positions: vec![Vec3::ZERO; 3], ..Mesh::default() }.named("leaf");
        let whole = Cutout {
            uv: vec![Vec2::ZERO; 3],
            alpha: Arc::new(map(Wrap::Repeat, false)),
            cutoff: 127.5,
        };
        assert_eq!(whole.validate(&mesh), Ok(()), "a sound one");
        let short = AlphaMap { texels: vec![0], ..map(Wrap::Repeat, false) };
        let broken = [
            Cutout { uv: vec![Vec2::ZERO; 2], ..whole.clone() },
            Cutout { uv: vec![Vec2::NAN; 3], ..whole.clone() },
            Cutout { cutoff: f32::NAN, ..whole.clone() },
            Cutout { alpha: Arc::default(), ..whole.clone() },
            Cutout { alpha: Arc::new(short), ..whole },
        ];
        for cutout in broken {
            let fault = cutout.validate(&mesh).expect_err("a fault");
            assert!(fault.to_string().contains("leaf"), "{fault}");
        }
    }
}
