//! A scene: meshes placed in a world, with a camera and lights.

use std::borrow::Cow;
use std::io::{self, Write};

use glam::{DAffine3, DVec3, Vec3};

use crate::{
    Bounds, Camera, CutInstance, Cutouts, Light, Mesh, MeshError, Opacities, TranslucentInstance,
};

/// A mesh placed in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct Instance {
    /// Name, for messages and files.
    pub name: String,
    /// Index into [`Scene::meshes`].
    pub mesh: usize,
    /// Mesh space to world space.
    pub transform: DAffine3,
}

/// Meshes placed in a world, seen by a camera, lit by lights.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// Name, for tables and file names.
    pub name: String,
    /// Geometry, each mesh in its own space.
    pub meshes: Vec<Mesh>,
    /// Those meshes of which only a part is there, by their index into [`Scene::meshes`].
    pub cutouts: Cutouts,
    /// Those meshes that let a part of the light through, by their index into [`Scene::meshes`]. One that is among
    /// [`Scene::cutouts`] too counts as translucent alone.
    pub opacities: Opacities,
    /// Meshes placed in the world.
    pub instances: Vec<Instance>,
    /// The camera, where the scene brings one.
    pub camera: Option<Camera>,
    /// The lights that the scene brings.
    pub lights: Vec<Light>,
    /// Index into [`Scene::instances`] of the ground that [`Scene::add_ground`] added, which has no
    /// say in where cameras and lights are placed.
    pub ground: Option<usize>,
}

/// The triangles of a scene in one list, `f32` relative to an origin.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Triangles {
    /// World position of the list's zero, metres.
    pub origin: DVec3,
    /// Vertex positions relative to `origin`, metres.
    pub positions: Vec<Vec3>,
    /// Three vertex indices a triangle.
    pub triangles: Vec<[u32; 3]>,
    /// For each instance of the scene, the range of its triangles.
    pub instances: Vec<std::ops::Range<usize>>,
    /// The instances of which only a part is there, in their order.
    pub cuts: Vec<CutInstance>,
    /// The instances that let a part of the light through, in their order.
    pub translucent: Vec<TranslucentInstance>,
}

impl Scene {
    /// Adds `mesh` to the scene and places it in the world.
    pub fn add(&mut self, mesh: Mesh, transform: DAffine3) {
        self.instances.push(Instance {
            name: mesh.name.clone(),
            mesh: self.meshes.len(),
            transform,
        });
        self.meshes.push(mesh);
    }

    /// The box around the triangles of one instance, world space; empty where its mesh does not
    /// exist. Indices beyond the mesh's vertices are passed over.
    #[must_use]
    pub fn instance_bounds(&self, instance: &Instance) -> Bounds {
        let Some(mesh) = self.meshes.get(instance.mesh) else {
            return Bounds::EMPTY;
        };
        let corners = mesh.triangles.iter().flatten();
        Bounds::of(
            corners
                .filter_map(|&i| mesh.positions.get(i as usize))
                .map(|p| instance.transform.transform_point3(p.as_dvec3())),
        )
    }

    /// The box around all triangles, world space.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        self.instances
            .iter()
            .fold(Bounds::EMPTY, |b, instance| b.union(self.instance_bounds(instance)))
    }

    /// Number of triangles over all instances.
    #[must_use]
    pub fn triangle_count(&self) -> usize {
        let meshes = self.instances.iter().filter_map(|i| self.meshes.get(i.mesh));
        meshes.map(|mesh| mesh.triangles.len()).sum()
    }

    /// The same scene moved by `offset`, metres: geometry, camera and lights.
    #[must_use]
    pub fn translated(&self, offset: DVec3) -> Self {
        let mut moved = self.clone();
        for instance in &mut moved.instances {
            instance.transform.translation += offset;
        }
        moved.camera = moved.camera.map(|camera| camera.translated(offset));
        for light in &mut moved.lights {
            *light = light.translated(offset);
        }
        moved
    }

    /// An origin near the scene for `f32` work: zero where the scene lies around the world's origin,
    /// otherwise the centre of its bounds, rounded to a power-of-two grid no coarser than the scene,
    /// so that a scene far out, moved by a multiple of the grid's step, keeps the same relative
    /// positions.
    #[must_use]
    pub fn origin(&self) -> DVec3 {
        let bounds = self.bounds();
        if bounds.is_empty() {
            return DVec3::ZERO;
        }
        let (center, radius) = (bounds.center(), bounds.radius());
        // A vertex then lies within 17 radii, which costs f32 at most 5 of its 24 bits against a
        // scene around its origin.
        if center.length() <= 16.0 * radius {
            return DVec3::ZERO;
        }
        // Below 2^-40 of the distance (a scene that is nearly a point), a finer grid would only
        // exceed what f64 holds: center / step stays below 2^40, where every integer is exact.
        let step = radius.max(center.length() * (-40.0_f64).exp2()).log2().ceil().exp2();
        (center / step).round() * step
    }

    /// All triangles relative to `origin` (world space, metres).
    ///
    /// # Errors
    /// A mesh that fails [`Mesh::validate`], a cut-out or opacity that does not fit its mesh, an instance of a mesh that does not exist, a vertex
    /// whose place relative to `origin` is no finite `f32`, or more than `u32::MAX` vertices.
    pub fn triangles(&self, origin: DVec3) -> Result<Triangles, MeshError> {
        for mesh in &self.meshes {
            mesh.validate()?;
        }
        for (&mesh, cutout) in &self.cutouts {
            let meshes = self.meshes.len();
            let fault = MeshError::CutoutOfNothing { mesh, meshes };
            cutout.validate(self.meshes.get(mesh).ok_or(fault)?)?;
        }
        for (&mesh, opacity) in &self.opacities {
            let meshes = self.meshes.len();
            let fault = MeshError::OpacityOfNothing { mesh, meshes };
            opacity.validate(self.meshes.get(mesh).ok_or(fault)?)?;
        }
        let mut out = Triangles { origin, ..Triangles::default() };
        for instance in &self.instances {
            let mesh = self.meshes.get(instance.mesh).ok_or_else(|| MeshError::NoSuchMesh {
                instance: instance.name.clone(),
                mesh: instance.mesh,
                meshes: self.meshes.len(),
            })?;
            let (first_vertex, first) = (out.positions.len(), out.triangles.len());
            // The last vertex must have a 32-bit index; so then have all below it.
            u32::try_from(first_vertex + mesh.positions.len()).map_err(|_| MeshError::TooLarge)?;
            let base = first_vertex as u32;
            let number = out.instances.len();
            if let Some(opacity) = self.opacities.get(&instance.mesh) {
                out.translucent.push(TranslucentInstance {
                    instance: number,
                    first_vertex: base,
                    opacity: opacity.clone(),
                });
            } else if let Some(cutout) = self.cutouts.get(&instance.mesh) {
                out.cuts.push(CutInstance {
                    instance: number,
                    first_vertex: base,
                    cutout: cutout.clone(),
                });
            }
            for (vertex, p) in mesh.positions.iter().enumerate() {
                let place = instance.transform.transform_point3(p.as_dvec3()) - origin;
                if !place.as_vec3().is_finite() {
                    return Err(MeshError::OutOfReach { instance: instance.name.clone(), vertex });
                }
                out.positions.push(place.as_vec3());
            }
            out.triangles.extend(mesh.triangles.iter().map(|t| t.map(|i| i + base)));
            out.instances.push(first..out.triangles.len());
        }
        Ok(out)
    }
}

impl Triangles {
    /// What hides the light where it is: the triangles without those that let a part of it through, whose instances keep
    /// their numbers and have none.
    #[must_use]
    pub fn opaque(&self) -> Cow<'_, Self> {
        if self.translucent.is_empty() {
            return Cow::Borrowed(self);
        }
        let mut keeps = vec![true; self.instances.len()];
        self.translucent.iter().for_each(|t| keeps[t.instance] = false);
        let mut opaque = Self {
            triangles: Vec::new(),
            instances: Vec::new(),
            translucent: Vec::new(),
            ..self.clone()
        };
        for (range, keep) in self.instances.iter().zip(keeps) {
            let first = opaque.triangles.len();
            if keep {
                opaque.triangles.extend_from_slice(&self.triangles[range.clone()]);
            }
            opaque.instances.push(first..opaque.triangles.len());
        }
        Cow::Owned(opaque)
    }

    /// Writes the triangles as a Wavefront OBJ file in world space, one object for each instance, all of them whole.
    ///
    /// Coordinates are `origin` plus position in `f64`, in the shortest decimal form that reads
    /// back as the same `f64`; with an origin of zero they therefore read back as the same `f32`.
    ///
    /// # Errors
    /// Whatever `writer` reports.
    pub fn write_obj(&self, mut writer: impl Write) -> io::Result<()> {
        for p in &self.positions {
            let world = self.origin + p.as_dvec3();
            writeln!(writer, "v {} {} {}", world.x, world.y, world.z)?;
        }
        let mut next = 0;
        for (instance, range) in self.instances.iter().enumerate() {
            writeln!(writer, "o instance_{instance}")?;
            let range = range.start.min(self.triangles.len())..range.end.min(self.triangles.len());
            next = range.end.max(next);
            write_faces(&mut writer, self.triangles.get(range).unwrap_or_default())?;
        }
        // Triangle lists made without instances are written all the same.
        write_faces(&mut writer, &self.triangles[next..])
    }
}

fn write_faces(writer: &mut impl Write, triangles: &[[u32; 3]]) -> io::Result<()> {
    for t in triangles {
        let [a, b, c] = t.map(|i| u64::from(i) + 1);
        writeln!(writer, "f {a} {b} {c}")?;
    }
    Ok(())
}
