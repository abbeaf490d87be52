//! A ray tracer for triangles that answers one question exactly: is the way free?

mod build;
mod cut;
mod lanes;
mod sheets;
mod traverse;

use antumbra_scene::Triangles;
use cut::{Cuts, Surface, Whole};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

#[cfg(target_arch = "x86_64")]
use lanes::Avx2;
use lanes::Portable;
use sheets::{Sheets, Through};
pub(crate) use traverse::U;
use traverse::Visitor;

/// The largest absolute coordinate, metres, of triangles and of the origins of rays: 2^40, about
/// 1.1e12. Beyond it products of three lengths would overflow `f32`.
pub const LARGEST_COORDINATE: f32 = (1_u64 << 40) as f32;

/// Triangles that cannot be traced.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TraceError {
    /// A corner of a triangle is infinite, not a number, or beyond [`LARGEST_COORDINATE`].
    #[error(
        "triangle {triangle}: a coordinate is not finite or beyond 2^40 m; repair the mesh, or choose an origin or unit nearer to it"
    )]
    Position {
        /// Index of the first such triangle.
        triangle: usize,
    },
    /// A triangle refers to a vertex that does not exist.
    #[error("triangle {triangle} refers to a vertex beyond the {vertices} there are")]
    IndexOutOfRange {
        /// Index of the first such triangle.
        triangle: usize,
        /// Number of vertices.
        vertices: usize,
    },
    /// A cut-out has no texture, or not one texture coordinate for each vertex of its triangles.
    #[error(
        "triangle {triangle}: its cut-out lacks a texture or texture coordinates; check it by `Cutout::validate`"
    )]
    Cutout {
        /// Index of the first such triangle, or 0 where an instance or the whole texture is missing.
        triangle: usize,
    },
    /// A translucent surface has no texture, or not one texture coordinate for each vertex of its triangles.
    #[error(
        "triangle {triangle}: its opacity lacks a texture or texture coordinates; check it by `Opacity::validate`"
    )]
    Opacity {
        /// Index of the first such triangle, or 0 where an instance or the whole texture is missing.
        triangle: usize,
    },
    /// More than 2^30 triangles.
    #[error("more than 1073741824 triangles; split the scene")]
    TooMany,
}

/// A segment or a half-line from `origin`, open at both ends: the points origin + t direction with
/// 0 < t < `t_max`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Start, metres, relative to [`Triangles::origin`].
    pub origin: Vec3,
    /// Direction, of any length but zero.
    pub direction: Vec3,
    /// End, in lengths of `direction`; may be infinite.
    pub t_max: f32,
}

/// Where a ray first meets a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance in lengths of the ray's direction.
    pub t: f32,
    /// Index of the triangle; the lowest of several at the same distance.
    pub triangle: u32,
}

/// Triangles in a tree, ready to be asked whether they block a ray.
///
/// Both sides of a triangle block, and of a cut-out what is there of it; translucent ones do not block, and have a say in
/// [`Tracer::transmittance`] and [`Tracer::truth`] alone. Neighbours that share an edge or a vertex leave no gap between
/// them for any ray. Answers depend on the triangles and the ray alone: not on the processor, the
/// number of threads or the shape of the tree.
#[derive(Clone)]
pub struct Tracer {
    tree: build::Tree,
    /// Triangles with holes, where there are any.
    cuts: Option<Cuts>,
    /// Triangles that let light through, where there are any, in a tree of their own.
    sheets: Option<Sheets>,
    /// [`Triangles::origin`].
    origin: DVec3,
    /// Largest absolute coordinate of a triangle, metres.
    extent: f32,
    /// Half of the diagonal of the bounding box, metres.
    radius: f32,
    instructions: Instructions,
}

impl std::fmt::Debug for Tracer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Tracer")
            .field("nodes", &self.tree.nodes.len())
            .field("packets", &self.tree.packets.len())
            .field("extent", &self.extent)
            .finish_non_exhaustive()
    }
}

impl Tracer {
    /// Builds the tree, on all cores.
    ///
    /// # Errors
    /// A triangle with a faulty index or coordinate, a cut-out without its data, or too many triangles.
    pub fn new(triangles: &Triangles) -> Result<Self, TraceError> {
        if triangles.triangles.len() > 1 << 30 {
            return Err(TraceError::TooMany);
        }
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for (triangle, corners) in triangles.triangles.iter().enumerate() {
            for &index in corners {
                let Some(&p) = triangles.positions.get(index as usize) else {
                    let vertices = triangles.positions.len();
                    return Err(TraceError::IndexOutOfRange { triangle, vertices });
                };
                if !p.abs().cmple(Vec3::splat(LARGEST_COORDINATE)).all() {
                    return Err(TraceError::Position { triangle });
                }
                (low, high) = (low.min(p), high.max(p));
            }
        }
        let empty = triangles.triangles.is_empty();
        let sheets = Sheets::new(triangles)?;
        let opaque = triangles.opaque();
        Ok(Self {
            tree: build::build(&opaque),
            cuts: Cuts::new(&opaque)?,
            sheets,
            origin: triangles.origin,
            extent: if empty { 0.0 } else { low.abs().max(high.abs()).max_element() },
            radius: if empty { 0.0 } else { 0.5 * (high - low).length() },
            instructions: Instructions::detect(),
        })
    }

    /// The same tracer on these instructions, or on the best that the processor has of those below
    /// them. For comparison; [`Tracer::new`] takes the best.
    #[must_use]
    pub fn at_most(mut self, instructions: Instructions) -> Self {
        self.instructions = instructions.min(Instructions::detect());
        self
    }

    /// The instructions in use.
    #[must_use]
    pub fn instructions(&self) -> Instructions {
        self.instructions
    }

    /// World position, metres, that triangles and rays are relative to: [`Triangles::origin`].
    #[must_use]
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// Largest absolute coordinate of a triangle, metres; 0 without triangles.
    #[must_use]
    pub fn extent(&self) -> f32 {
        self.extent
    }

    /// Half of the diagonal of the triangles' bounding box, metres; 0 without triangles.
    #[must_use]
    pub fn radius(&self) -> f32 {
        self.radius
    }

    /// Whether a triangle lies on the segment from `origin` (metres, relative to
    /// [`Triangles::origin`]) to `origin + t_max * direction`, the ends excluded. `direction` may have
    /// any length but zero, `t_max` may be infinite.
    ///
    /// A ray that is not finite (but for `t_max`) or has no length meets nothing. Origins beyond
    /// [`LARGEST_COORDINATE`] are beyond what is answered reliably.
    #[must_use]
    #[inline]
    pub fn occluded(&self, origin: Vec3, direction: Vec3, t_max: f32) -> bool {
        let ray = Ray { origin, direction, t_max };
        match &self.cuts {
            None => self.traverse(&ray, &mut Any(Whole)),
            Some(cuts) => self.traverse(&ray, &mut Any(cuts)),
        }
    }

    /// The share of the light, in [0, 1], that gets along such a segment: 0 where it is occluded, else what all
    /// translucent triangles on it together let through (their product, Eisemann, Schwarz, Assarsson, Wimmer 2011,
    /// section 2.5). At an edge between two of them, which rounding may take for both, it may be too little.
    #[must_use]
    pub fn transmittance(&self, ray: &Ray) -> f64 {
        if self.occluded(ray.origin, ray.direction, ray.t_max) { 0.0 } else { self.through(ray) }
    }

    /// What translucent triangles let through.
    #[inline]
    pub(crate) fn through(&self, ray: &Ray) -> f64 {
        self.sheets.as_ref().map_or(1.0, |sheets| {
            let mut through = Through::new(sheets);
            traverse::one::<Portable, _>(&sheets.tree, ray, self.extent, &mut through);
            through.share
        })
    }

    /// Whether some triangles let light through.
    pub(crate) fn has_sheets(&self) -> bool {
        self.sheets.is_some()
    }

    /// [`Tracer::occluded`] for many rays, on all cores. An eighth faster than one ray after the other,
    /// on each of them.
    #[must_use]
    pub fn occluded_all(&self, rays: &[Ray]) -> Vec<bool> {
        const CHUNK: usize = 1024;
        let mut blocked = vec![false; rays.len()];
        rays.par_chunks(CHUNK)
            .zip(blocked.par_chunks_mut(CHUNK))
            .for_each(|(rays, blocked)| self.occluded_each(rays, blocked));
        blocked
    }

    /// [`Tracer::occluded`] for many rays, on this thread.
    pub(crate) fn occluded_each(&self, rays: &[Ray], blocked: &mut [bool]) {
        match &self.cuts {
            None => self.each(rays, Whole, blocked),
            Some(cuts) => self.each(rays, cuts, blocked),
        }
    }

    fn each<S: Surface>(&self, rays: &[Ray], surface: S, blocked: &mut [bool]) {
        let (tree, extent) = (&self.tree, self.extent);
        match self.instructions {
            // SAFETY: such instructions are only set where they were detected.
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx512 => unsafe { each_avx512(tree, rays, extent, surface, blocked) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx2 => unsafe { each_avx2(tree, rays, extent, surface, blocked) },
            _ => traverse::each::<Portable, S>(tree, rays, extent, surface, blocked),
        }
    }

    /// The first triangle that a ray meets, by its number in the list that [`Triangles::opaque`] gives. Slower than [`Tracer::occluded`]: meant for finding the
    /// points that a camera sees, not for shadows.
    #[must_use]
    pub fn closest(&self, ray: &Ray) -> Option<Hit> {
        match &self.cuts {
            None => self.closest_of(ray, Whole),
            Some(cuts) => self.closest_of(ray, cuts),
        }
    }

    fn closest_of<S: Surface>(&self, ray: &Ray, surface: S) -> Option<Hit> {
        let mut closest = Closest { surface, depth: f64::INFINITY, triangle: u32::MAX };
        let longest = f64::from(ray.direction.abs().max_element());
        self.traverse(ray, &mut closest)
            .then(|| Hit { t: (closest.depth / longest) as f32, triangle: closest.triangle })
    }

    #[inline]
    fn traverse<V: Visitor>(&self, ray: &Ray, visitor: &mut V) -> bool {
        match self.instructions {
            // SAFETY: such instructions are only set where they were detected.
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx512 => unsafe { one_avx512(&self.tree, ray, self.extent, visitor) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx2 => unsafe { one_avx2(&self.tree, ray, self.extent, visitor) },
            _ => traverse::one::<Portable, V>(&self.tree, ray, self.extent, visitor),
        }
    }
}

/// What a [`Tracer`] computes with. Its answers do not depend on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Instructions {
    /// Those of any processor.
    Portable,
    /// Eight lanes in 16 registers (x86-64, from 2013).
    Avx2,
    /// Eight lanes in 32 registers: a tenth faster, since a ray and a box fit without spilling.
    Avx512,
}

impl Instructions {
    /// The best of this processor.
    #[must_use]
    pub fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            use std::arch::is_x86_feature_detected as has;
            if has!("avx2")
                && has!("fma")
                && has!("popcnt")
                && has!("bmi1")
                && has!("bmi2")
                && has!("lzcnt")
            {
                return if has!("avx512f") && has!("avx512vl") { Self::Avx512 } else { Self::Avx2 };
            }
        }
        Self::Portable
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,popcnt,bmi1,bmi2,lzcnt")]
fn one_avx2<V: Visitor>(tree: &build::Tree, ray: &Ray, extent: f32, visitor: &mut V) -> bool {
    traverse::one::<Avx2, V>(tree, ray, extent, visitor)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,popcnt,bmi1,bmi2,lzcnt,avx512f,avx512vl")]
fn one_avx512<V: Visitor>(tree: &build::Tree, ray: &Ray, extent: f32, visitor: &mut V) -> bool {
    traverse::one::<Avx2, V>(tree, ray, extent, visitor)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,popcnt,bmi1,bmi2,lzcnt")]
fn each_avx2<S: Surface>(
    tree: &build::Tree,
    rays: &[Ray],
    extent: f32,
    surface: S,
    blocked: &mut [bool],
) {
    traverse::each::<Avx2, S>(tree, rays, extent, surface, blocked);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,popcnt,bmi1,bmi2,lzcnt,avx512f,avx512vl")]
fn each_avx512<S: Surface>(
    tree: &build::Tree,
    rays: &[Ray],
    extent: f32,
    surface: S,
    blocked: &mut [bool],
) {
    traverse::each::<Avx2, S>(tree, rays, extent, surface, blocked);
}

/// Ends at whatever is met.
struct Any<S>(S);

impl<S: Surface> Visitor for Any<S> {
    type Surface = S;
    const DEPTHS: bool = false;
    #[inline(always)]
    fn surface(&self) -> S {
        self.0
    }
    fn meet(&mut self, _: u32, _: f64, _: [f64; 3]) -> f32 {
        0.0
    }
}

/// Keeps what is met first.
struct Closest<S> {
    surface: S,
    depth: f64,
    triangle: u32,
}

impl<S: Surface> Visitor for Closest<S> {
    type Surface = S;
    const DEPTHS: bool = true;
    #[inline(always)]
    fn surface(&self) -> S {
        self.surface
    }
    fn meet(&mut self, triangle: u32, depth: f64, _: [f64; 3]) -> f32 {
        if (depth, triangle) < (self.depth, self.triangle) {
            (self.depth, self.triangle) = (depth, triangle);
        }
        // Rounded up, so that others at the same depth are still seen.
        (self.depth as f32).next_up()
    }
}
