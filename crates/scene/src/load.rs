//! Scene files: glTF 2.0 (`.gltf`, `.glb`), Wavefront OBJ (`.obj`) and the scene description of this
//! project (`.toml`).
//!
//! A file is either refused with an error that names it and its fault, or loaded with every repair
//! counted. What comes out satisfies [`Mesh::validate`](crate::Mesh::validate), has no triangle of
//! zero area in its mesh's space, and lies within [`REACH`] of the world's origin.

mod base64;
mod clean;
mod gltf_file;
mod obj_file;
mod toml_file;

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;
use std::sync::Arc;

use glam::DAffine3;

use crate::{Bounds, Cutout, LoadError, Mesh, MeshError, Opacity, Scene};

/// The largest coordinate that a loaded scene may have, metres.
///
/// The determinant of three edges, each up to 2 x `REACH` long on every axis, sums 6 products of at
/// most (2e12)^3; 4.8e37 still is a finite `f32`.
pub const REACH: f64 = 1e12;

/// How to load a scene file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LoadOptions {
    /// Whether vertices of one mesh at bit for bit the same position become one vertex, so that
    /// triangles which touch also share their edge. Files split vertices where normals or texture
    /// coordinates differ, and neither is kept. Default: true. Cost: none worth naming.
    pub weld: bool,
    /// Most triangles that a scene may have, counted over all instances, so that a small file with
    /// many instances cannot exhaust the memory. Default: 100 million, about 2 GB as one list.
    pub max_triangles: usize,
}

impl Default for LoadOptions {
    fn default() -> Self {
        Self { weld: true, max_triangles: 100_000_000 }
    }
}

/// What was repaired or left out while loading.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Repairs {
    /// Triangles dropped because a corner has an infinite or undefined coordinate.
    pub non_finite_triangles: usize,
    /// Triangles dropped because they have no area, in their mesh's space or under a transform that
    /// flattens them, or because the file ends within them.
    pub degenerate_triangles: usize,
    /// Groups of points or lines left out: glTF primitives, OBJ elements.
    pub skipped_primitives: usize,
    /// Cameras left out: orthographic ones, impossible numbers, all but the first of a file.
    pub ignored_cameras: usize,
    /// Lights left out because of impossible numbers.
    pub ignored_lights: usize,
    /// glTF primitives taken as whole though their material cuts holes into them or lets light through: its texture or its
    /// texture coordinates are missing or cannot be read.
    pub opaque_materials: usize,
}

impl Repairs {
    /// Whether nothing was repaired or left out.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

impl fmt::Display for Repairs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let all = [
            (self.non_finite_triangles, "non-finite triangles dropped"),
            (self.degenerate_triangles, "degenerate triangles dropped"),
            (self.skipped_primitives, "primitives without triangles skipped"),
            (self.ignored_cameras, "cameras ignored"),
            (self.ignored_lights, "lights ignored"),
            (self.opaque_materials, "cut-out or translucent surfaces taken as whole"),
        ];
        let some: Vec<String> =
            all.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")).collect();
        f.write_str(if some.is_empty() { "nothing repaired" } else { "" })?;
        f.write_str(&some.join(", "))
    }
}

/// Loads a scene file, chosen by its ending (`.glb`, `.gltf`, `.obj`, `.toml`, in any case).
///
/// glTF: the default scene, or else the first, or else all root nodes; the mesh of several nodes
/// becomes several instances; triangles, strips and fans, indexed or not; sparse and quantised
/// positions; perspective cameras; `KHR_lights_punctual`. Skins and morph targets stay at rest;
/// of materials only alpha counts, that of the base colour's factor and texture (PNG, with `KHR_texture_transform`):
/// what cuts holes (`alphaMode` MASK) and what lets light through (BLEND).
///
/// OBJ: `v`, `f` and `o` lines; each `o` begins a mesh; a polygon becomes the fan around its first
/// corner, which is exact where it is convex and flat.
///
/// TOML: geometry files placed in a world, a camera, lights of all kinds, a ground; every key is
/// described in `docs/scene-files.md`:
///
/// ```toml
/// name = "two bunnies"
///
/// [[mesh]]
/// file = "bunny.obj"
///
/// [[mesh]]
/// file = "bunny.obj"
/// translate = [2.0, 0.0, 0.0]  # metres
/// rotate = [0.0, 90.0, 0.0]    # degrees around x, then y, then z
/// scale = 0.5
///
/// [[light]]
/// kind = "directional"
/// direction = [-1.0, -2.0, -0.5]
/// angular_diameter = 0.53      # degrees
///
/// [ground]
/// ```
///
/// # Errors
/// The file or one it refers to cannot be read or understood, has an unknown ending, holds no
/// triangle, refers to vertices or nodes that do not exist, has nodes with two parents or cycles, or
/// lies beyond [`REACH`] or [`LoadOptions::max_triangles`].
pub fn load(path: &Path, options: &LoadOptions) -> Result<(Scene, Repairs), LoadError> {
    let mut repairs = Repairs::default();
    let mut scene = if has_ending(path, &["toml"]) {
        toml_file::load(path, options, &mut repairs)?
    } else {
        load_geometry(path, options, &mut repairs)?
    };
    flatten_singular(&mut scene, &mut repairs);
    check(path, &scene, options, repairs)?;
    if scene.name.is_empty() {
        scene.name = stem(path);
    }
    Ok((scene, repairs))
}

/// Loads a file of any format but TOML, without the checks on the scene as a whole.
fn load_geometry(
    path: &Path,
    options: &LoadOptions,
    repairs: &mut Repairs,
) -> Result<Scene, LoadError> {
    if has_ending(path, &["glb", "gltf"]) {
        gltf_file::load(path, options, repairs)
    } else if has_ending(path, &["obj"]) {
        obj_file::load(path, options, repairs)
    } else {
        Err(LoadError::UnknownFormat { path: path.to_owned() })
    }
}

fn has_ending(path: &Path, endings: &[&str]) -> bool {
    path.extension().is_some_and(|found| endings.iter().any(|e| found.eq_ignore_ascii_case(e)))
}

fn stem(path: &Path) -> String {
    path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default()
}

fn unreadable(path: &Path, reason: impl fmt::Display) -> LoadError {
    LoadError::Unreadable { path: path.to_owned(), reason: reason.to_string() }
}

/// The bytes of a regular file; of nothing else, because a pipe or a device may never end.
fn read_file(path: &Path) -> Result<Vec<u8>, LoadError> {
    let kind = std::fs::metadata(path).map_err(|e| unreadable(path, e))?;
    if kind.is_dir() {
        return Err(unreadable(path, "is a directory; name the file in it"));
    }
    if !kind.is_file() {
        return Err(unreadable(path, "is no regular file"));
    }
    let bytes = std::fs::read(path).map_err(|e| unreadable(path, e))?;
    if bytes.is_empty() {
        let hint = ": the file is empty".to_owned();
        return Err(LoadError::Empty { path: path.to_owned(), hint });
    }
    Ok(bytes)
}

/// Gives every instance whose transform has no inverse a flattened mesh of its own, because which of
/// its triangles keep an area depends on the transform.
fn flatten_singular(scene: &mut Scene, repairs: &mut Repairs) {
    let Scene { meshes, instances, cutouts, opacities, .. } = scene;
    instances.retain_mut(|instance| {
        let Some(mesh) = meshes.get(instance.mesh) else {
            return false;
        };
        let m = instance.transform.matrix3;
        // Not finite: left as it is, for `check` to refuse.
        if m.determinant() != 0.0 || !instance.transform.is_finite() {
            return true;
        }
        let positions: Vec<_> =
            mesh.positions.iter().map(|p| (m * p.as_dvec3()).as_vec3()).collect();
        let cutout = cutouts.get(&instance.mesh).cloned();
        let opacity = opacities.get(&instance.mesh).cloned();
        let uv = cutout.as_ref().map(|cutout| cutout.uv.as_slice());
        let uv = uv.or(opacity.as_ref().map(|opacity| opacity.uv.as_slice()));
        let flat = clean::clean_with_uv(
            mesh.name.clone(),
            clean::Source::Welded(&positions),
            uv,
            mesh.triangles.iter().copied(),
            repairs,
        );
        let Ok((flat, uv)) = flat else {
            return false;
        };
        if let (Some(cutout), Some(uv)) = (&cutout, &uv) {
            let flat = Cutout { uv: uv.clone(), ..(**cutout).clone() };
            cutouts.insert(meshes.len(), Arc::new(flat));
        }
        if let (Some(opacity), Some(uv)) = (opacity, uv) {
            let flat = Opacity { uv, ..(*opacity).clone() };
            opacities.insert(meshes.len(), Arc::new(flat));
        }
        instance.mesh = meshes.len();
        instance.transform = DAffine3::from_translation(instance.transform.translation);
        let keep = !flat.triangles.is_empty();
        meshes.push(flat);
        keep
    });
    drop_unused_meshes(scene);
}

/// Removes meshes without instances and renumbers the others.
fn drop_unused_meshes(scene: &mut Scene) {
    let mut used = vec![false; scene.meshes.len()];
    for instance in &scene.instances {
        used[instance.mesh] = true;
    }
    let mut next = 0;
    let renumbered: Vec<usize> = used
        .iter()
        .map(|&u| {
            next += usize::from(u);
            next.saturating_sub(1)
        })
        .collect();
    for instance in &mut scene.instances {
        instance.mesh = renumbered[instance.mesh];
    }
    scene.cutouts = renumber(std::mem::take(&mut scene.cutouts), &used, &renumbered);
    scene.opacities = renumber(std::mem::take(&mut scene.opacities), &used, &renumbered);
    let mut used = used.iter();
    scene.meshes.retain(|_| used.next() == Some(&true));
}

/// What `used` meshes have, by their new numbers.
fn renumber<T>(of: BTreeMap<usize, T>, used: &[bool], renumbered: &[usize]) -> BTreeMap<usize, T> {
    let kept = of.into_iter().filter(|(mesh, _)| used[*mesh]);
    kept.map(|(mesh, value)| (renumbered[mesh], value)).collect()
}

/// Checks what no single mesh can know: that there are triangles, not too many, none too far out.
fn check(
    path: &Path,
    scene: &Scene,
    options: &LoadOptions,
    repairs: Repairs,
) -> Result<(), LoadError> {
    let count = (scene.instances.iter().enumerate())
        .filter(|&(index, _)| Some(index) != scene.ground)
        .fold(0_usize, |n, (_, i)| n.saturating_add(scene.meshes[i.mesh].triangles.len()));
    if count == 0 {
        let hint = if repairs.is_empty() { String::new() } else { format!(" ({repairs})") };
        return Err(LoadError::Empty { path: path.to_owned(), hint });
    }
    if count > options.max_triangles {
        return Err(LoadError::TooLarge { path: path.to_owned(), limit: options.max_triangles });
    }
    let boxes: Vec<Bounds> = scene.meshes.iter().map(Mesh::bounds).collect();
    for instance in &scene.instances {
        let place = |p| instance.transform.transform_point3(p);
        // The box of a transformed box is larger than that of the geometry: where it fits, the
        // geometry does.
        if boxes[instance.mesh].corners().map(place).iter().all(|p| within_reach(*p)) {
            continue;
        }
        let positions = &scene.meshes[instance.mesh].positions;
        if let Some(vertex) = positions.iter().position(|p| !within_reach(place(p.as_dvec3()))) {
            let source = MeshError::OutOfReach { instance: instance.name.clone(), vertex };
            return Err(LoadError::Mesh { path: path.to_owned(), source });
        }
    }
    Ok(())
}

/// Whether all coordinates are numbers within [`REACH`].
fn within_reach(p: glam::DVec3) -> bool {
    p.is_finite() && p.abs().max_element() <= REACH
}
