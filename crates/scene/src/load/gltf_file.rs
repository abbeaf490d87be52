//! glTF 2.0. Section numbers are those of the Khronos specification, version 2.0.1.
//!
//! The `gltf` crate parses; the walk over its data is done here with checked look-ups throughout,
//! because the crate's own accessors rely on validated files and a file may be anything.

mod accessor;
mod buffers;
mod mask;

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec2, Vec3};
use gltf::json::extensions::scene::khr_lights_punctual::Type as LightType;
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;
use gltf::json::{Index, Node, Root};
use serde_json::Value;

use super::clean::{Source, clean_with_uv};
use super::{LoadOptions, Repairs, read_file, unreadable};
use crate::{Camera, Instance, Light, LoadError, Mesh, Scene};
use accessor::Accessors;
use buffers::Buffers;
use mask::{Masks, Surface};

pub(super) fn load(
    path: &Path,
    options: &LoadOptions,
    repairs: &mut Repairs,
) -> Result<Scene, LoadError> {
    let bytes = read_file(path)?;
    let (json, blob) = split(&bytes).map_err(|reason| unreadable(path, reason))?;
    let (root, masks) = parse(json).map_err(|reason| unreadable(path, reason))?;
    repairs.opaque_materials += masks.faulty;
    let mut reader = Reader {
        path,
        options,
        repairs,
        accessors: Accessors::new(&root, Buffers::new(path, &root, blob)),
        root: &root,
        scene: Scene::default(),
        masks,
        meshes: HashMap::new(),
        triangles: 0,
    };
    reader.walk()?;
    Ok(reader.scene)
}

/// The JSON text and, of a binary file, the binary chunk.
fn split(bytes: &[u8]) -> Result<(&[u8], Option<Vec<u8>>), String> {
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes, None));
    }
    // The crate subtracts the header's 12 bytes from the stated length without a look.
    let stated = bytes.get(8..12).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
    match stated {
        Some(stated) if stated as usize > bytes.len() => {
            return Err(format!("is cut off: {} of {stated} bytes are there", bytes.len()));
        }
        Some(12..) => {}
        _ => return Err("is cut off or damaged within its header".to_owned()),
    }
    let glb = gltf::binary::Glb::from_slice(bytes).map_err(|e| e.to_string())?;
    let blob = glb.bin.map(std::borrow::Cow::into_owned);
    match glb.json {
        std::borrow::Cow::Borrowed(json) => Ok((json, blob)),
        std::borrow::Cow::Owned(_) => Err("its JSON chunk cannot be read".to_owned()),
    }
}

/// Parses the JSON text without everything that has no shape: materials, images, animations, skins.
/// Faults there, a texture in an unknown format for one, then cannot stop the geometry. Materials are read before, for
/// what their alpha leaves of a shape.
fn parse(json: &[u8]) -> Result<(Root, Masks), String> {
    let mut root: Value = serde_json::from_slice(json).map_err(|e| format!("JSON: {e}"))?;
    let version = root.pointer("/asset/version").and_then(Value::as_str).unwrap_or_default();
    if !version.starts_with("2.") {
        return Err(format!("has glTF version `{version}`; only 2.x can be read"));
    }
    let required = root.get("extensionsRequired").and_then(Value::as_array);
    for extension in required.into_iter().flatten().filter_map(Value::as_str) {
        let harmless = ["KHR_materials_", "KHR_texture_", "EXT_texture_", "MSFT_texture_"];
        let handled = ["KHR_lights_punctual", "KHR_mesh_quantization"].contains(&extension);
        if !handled && !harmless.iter().any(|prefix| extension.starts_with(prefix)) {
            return Err(format!("requires the extension `{extension}`, which is not supported"));
        }
    }
    let masks = Masks::new(&root);
    if let Some(root) = root.as_object_mut() {
        for key in ["materials", "textures", "images", "samplers", "animations", "skins"] {
            root.remove(key);
        }
    }
    for (mesh, object) in elements(&mut root, "meshes").iter_mut().enumerate() {
        for (number, primitive) in elements(object, "primitives").iter_mut().enumerate() {
            let Some(primitive) = primitive.as_object_mut() else { continue };
            for key in ["material", "targets", "extensions", "extras"] {
                primitive.remove(key);
            }
            let attributes = primitive.get_mut("attributes").and_then(Value::as_object_mut);
            if let Some(attributes) = attributes {
                attributes.retain(|name, accessor| {
                    let is_uv = accessor.is_u64() && masks.reads(mesh, number, name);
                    name == "POSITION" || is_uv
                });
            }
        }
    }
    for node in elements(&mut root, "nodes").iter_mut().filter_map(Value::as_object_mut) {
        for key in ["skin", "weights", "extras"] {
            node.remove(key);
        }
    }
    for scene in elements(&mut root, "scenes").iter_mut().filter_map(Value::as_object_mut) {
        scene.entry("nodes").or_insert_with(|| Value::Array(Vec::new()));
    }
    let root = gltf::json::deserialize::from_value(root).map_err(|e| format!("JSON: {e}"))?;
    Ok((root, masks))
}

fn elements<'a>(value: &'a mut Value, key: &str) -> &'a mut [Value] {
    match value.get_mut(key) {
        Some(Value::Array(elements)) => elements,
        _ => &mut [],
    }
}

/// The state of one walk over the nodes.
struct Reader<'a> {
    path: &'a Path,
    options: &'a LoadOptions,
    repairs: &'a mut Repairs,
    root: &'a Root,
    accessors: Accessors<'a>,
    masks: Masks,
    scene: Scene,
    /// For each glTF mesh met so far the scene's meshes of its primitives.
    meshes: HashMap<usize, Vec<usize>>,
    /// Triangles so far, over all instances.
    triangles: usize,
}

impl Reader<'_> {
    fn fault(&self, reason: impl std::fmt::Display) -> LoadError {
        unreadable(self.path, reason)
    }

    /// Visits the nodes of the scene, parents first, with a stack of its own: the depth of a file is
    /// no reason to run out of the thread's.
    fn walk(&mut self) -> Result<(), LoadError> {
        let nodes = &self.root.nodes;
        let mut seen = vec![false; nodes.len()];
        let mut stack: Vec<(usize, DAffine3)> =
            self.roots()?.into_iter().rev().map(|n| (n, DAffine3::IDENTITY)).collect();
        while let Some((index, parent)) = stack.pop() {
            let node = (nodes.get(index))
                .ok_or_else(|| self.fault(format!("refers to node {index} of {}", nodes.len())))?;
            // Section 3.5.2: a node has one parent at most, and there are no cycles.
            if std::mem::replace(&mut seen[index], true) {
                return Err(self.fault(format!(
                    "node {index} has two parents or is its own ancestor; \
                     the nodes of a glTF file must form trees"
                )));
            }
            let local = local_transform(node)
                .map_err(|reason| self.fault(format!("node {index}: {reason}")))?;
            let world = parent * local;
            self.visit(index, node, world)?;
            let children = node.children.as_deref().unwrap_or_default();
            stack.extend(children.iter().rev().map(|child| (child.value(), world)));
        }
        Ok(())
    }

    /// The root nodes of the default scene, or else the first; without scenes, all nodes that are
    /// no other's child.
    fn roots(&self) -> Result<Vec<usize>, LoadError> {
        let scenes = &self.root.scenes;
        let chosen = self.root.scene.map_or(0, |s| s.value());
        if let Some(scene) = scenes.get(chosen) {
            return Ok(scene.nodes.iter().map(Index::value).collect());
        }
        if self.root.scene.is_some() {
            return Err(self.fault(format!("refers to scene {chosen} of {}", scenes.len())));
        }
        let mut is_root = vec![true; self.root.nodes.len()];
        for child in self.root.nodes.iter().filter_map(|n| n.children.as_ref()).flatten() {
            if let Some(is_root) = is_root.get_mut(child.value()) {
                *is_root = false;
            }
        }
        Ok((0..is_root.len()).filter(|&n| is_root[n]).collect())
    }

    fn visit(&mut self, index: usize, node: &Node, world: DAffine3) -> Result<(), LoadError> {
        if let Some(camera) = node.camera {
            let camera = self.root.get(camera).and_then(|c| read_camera(c, &world));
            match (camera, self.scene.camera) {
                (Some(camera), None) => self.scene.camera = Some(camera),
                _ => self.repairs.ignored_cameras += 1,
            }
        }
        let lights = node.extensions.as_ref().and_then(|e| e.khr_lights_punctual.as_ref());
        if let Some(reference) = lights {
            match self.root.get(reference.light).and_then(|light| read_light(light, &world)) {
                Some(light) => self.scene.lights.push(light),
                None => self.repairs.ignored_lights += 1,
            }
        }
        let Some(mesh) = node.mesh else {
            return Ok(());
        };
        for mesh in self.mesh(mesh.value())? {
            let name = node.name.clone().unwrap_or_else(|| format!("node {index}"));
            self.count(self.scene.meshes[mesh].triangles.len())?;
            self.scene.instances.push(Instance { name, mesh, transform: world });
        }
        Ok(())
    }

    fn count(&mut self, triangles: usize) -> Result<(), LoadError> {
        self.triangles = self.triangles.saturating_add(triangles);
        let limit = self.options.max_triangles;
        if self.triangles > limit {
            return Err(LoadError::TooLarge { path: self.path.to_owned(), limit });
        }
        Ok(())
    }

    /// The scene's meshes for the primitives of a glTF mesh, read when first asked for.
    fn mesh(&mut self, index: usize) -> Result<Vec<usize>, LoadError> {
        if let Some(known) = self.meshes.get(&index) {
            return Ok(known.clone());
        }
        let found = self.root.meshes.get(index).ok_or_else(|| {
            self.fault(format!("refers to mesh {index} of {}", self.root.meshes.len()))
        })?;
        let name = found.name.clone().unwrap_or_else(|| format!("mesh {index}"));
        let mut made = Vec::new();
        for (number, primitive) in found.primitives.iter().enumerate() {
            let name = match found.primitives.len() {
                1 => name.clone(),
                _ => format!("{name}.{number}"),
            };
            let Some((mesh, surface)) = self.primitive(name, primitive, (index, number))? else {
                continue;
            };
            if !mesh.triangles.is_empty() {
                made.push(self.scene.meshes.len());
                let number = self.scene.meshes.len();
                match surface {
                    Surface::Whole => {}
                    Surface::Cut(cutout) => {
                        self.scene.cutouts.insert(number, Arc::new(cutout));
                    }
                    Surface::Translucent(opacity) => {
                        self.scene.opacities.insert(number, Arc::new(opacity));
                    }
                }
                self.scene.meshes.push(mesh);
            }
        }
        self.meshes.insert(index, made.clone());
        Ok(made)
    }

    fn primitive(
        &mut self,
        name: String,
        primitive: &Primitive,
        number: (usize, usize),
    ) -> Result<Option<(Mesh, Surface)>, LoadError> {
        let in_mesh = |reason: String| format!("mesh `{name}`: {reason}");
        let Checked::Valid(mode) = primitive.mode else {
            return Err(self.fault(in_mesh("has a primitive of unknown mode".to_owned())));
        };
        let positions = primitive.attributes.get(&Checked::Valid(Semantic::Positions));
        let is_surface = matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan);
        let (Some(&positions), true) = (positions, is_surface) else {
            self.repairs.skipped_primitives += 1;
            return Ok(None);
        };
        let positions = self
            .accessors
            .positions(positions.value())
            .map_err(|reason| self.fault(in_mesh(reason)))?;
        let indices = match primitive.indices {
            None => (0..u32::try_from(positions.len()).unwrap_or(u32::MAX)).collect(),
            Some(indices) => self
                .accessors
                .indices(indices.value())
                .map_err(|reason| self.fault(in_mesh(reason)))?,
        };
        let count = match mode {
            Mode::Triangles => indices.len() / 3,
            _ => indices.len().saturating_sub(2),
        };
        if mode == Mode::Triangles && indices.len() % 3 != 0 {
            self.repairs.degenerate_triangles += 1;
        }
        if count > self.options.max_triangles {
            self.count(count)?;
        }
        let triangles = (0..count).map(|i| match mode {
            Mode::Triangles => [indices[3 * i], indices[3 * i + 1], indices[3 * i + 2]],
            // Section 3.7.2.1: every other triangle of a strip is turned to keep its winding.
            Mode::TriangleStrip => [indices[i], indices[i + 1 + i % 2], indices[i + 2 - i % 2]],
            _ => [indices[0], indices[i + 1], indices[i + 2]],
        });
        let source = if self.options.weld { Source::Welded } else { Source::Separate };
        let positions: &[Vec3] = &positions;
        let uv = self.texture_coordinates(primitive, number, positions.len());
        let (mesh, uv) =
            clean_with_uv(name, source(positions), uv.as_deref(), triangles, self.repairs)
                .map_err(|source| LoadError::Mesh { path: self.path.to_owned(), source })?;
        let surface = match (self.masks.of(number.0, number.1).cloned(), uv) {
            (Some(mask), Some(uv)) => {
                let made = self.masks.surface(&mask, &uv, &mut self.accessors);
                made.unwrap_or_else(|_| {
                    self.repairs.opaque_materials += 1;
                    Surface::Whole
                })
            }
            _ => Surface::Whole,
        };
        Ok(Some((mesh, surface)))
    }

    /// The texture coordinates by which a primitive is cut out or translucent: those of its vertices, of which there are `count`; all
    /// zero for a mask without a texture; `None` where it is not, or where they are of no use.
    fn texture_coordinates(
        &mut self,
        primitive: &Primitive,
        (mesh, number): (usize, usize),
        count: usize,
    ) -> Option<Vec<Vec2>> {
        let Some(set) = self.masks.of(mesh, number)?.set() else {
            return Some(vec![Vec2::ZERO; count]);
        };
        let accessor = primitive.attributes.get(&Checked::Valid(Semantic::TexCoords(set)));
        let uv = accessor.and_then(|a| self.accessors.texture_coordinates(a.value()).ok());
        let uv = uv.filter(|uv| uv.len() == count && uv.iter().all(|uv| uv.is_finite()));
        self.repairs.opaque_materials += usize::from(uv.is_none());
        uv
    }
}

/// Section 3.5.3: a matrix, or translation, rotation and scale.
fn local_transform(node: &Node) -> Result<DAffine3, String> {
    let transform = if let Some(m) = node.matrix {
        let m = m.map(f64::from);
        if [m[3], m[7], m[11], m[15]] != [0.0, 0.0, 0.0, 1.0] {
            return Err("its matrix is no affine transform".to_owned());
        }
        DAffine3 {
            matrix3: DMat3::from_cols_array(&[
                m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10],
            ]),
            translation: DVec3::new(m[12], m[13], m[14]),
        }
    } else {
        let vector = |v: [f32; 3]| Vec3::from_array(v).as_dvec3();
        let rotation = match &node.rotation {
            None => DQuat::IDENTITY,
            Some(q) => {
                let q = DQuat::from_array(q.0.map(f64::from));
                // A unit quaternion by section 3.5.3; files round it. Zero stands for no direction.
                if !(q.is_finite() && q.length() > 0.0) {
                    return Err("its rotation is no unit quaternion".to_owned());
                }
                q.normalize()
            }
        };
        DAffine3::from_scale_rotation_translation(
            node.scale.map_or(DVec3::ONE, vector),
            rotation,
            node.translation.map_or(DVec3::ZERO, vector),
        )
    };
    if transform.is_finite() {
        Ok(transform)
    } else {
        Err("its transform is not finite".to_owned())
    }
}

/// Section 3.10: a camera looks along the -z axis of its node, +y up.
fn read_camera(camera: &gltf::json::Camera, world: &DAffine3) -> Option<Camera> {
    let perspective = camera.perspective.as_ref()?;
    let (fov_y, near) = (f64::from(perspective.yfov), f64::from(perspective.znear));
    let forward = world.transform_vector3(DVec3::NEG_Z).try_normalize()?;
    let eye = world.translation;
    let valid = fov_y > 0.0 && fov_y < std::f64::consts::PI && near > 0.0 && near.is_finite();
    (valid && super::within_reach(eye)).then(|| Camera {
        eye,
        target: eye + forward * distance_ahead(eye),
        up: world.transform_vector3(DVec3::Y).normalize_or(DVec3::Y),
        fov_y,
        near,
    })
}

/// How far ahead of a camera at `eye` its target goes: a metre, or farther out so far that the
/// difference of the two keeps 32 of the 53 bits of an f64.
fn distance_ahead(eye: DVec3) -> f64 {
    (eye.length() * (-21.0_f64).exp2()).max(1.0)
}

/// `KHR_lights_punctual`: lights shine along the -z axis of their node.
fn read_light(
    light: &gltf::json::extensions::scene::khr_lights_punctual::Light,
    world: &DAffine3,
) -> Option<Light> {
    let Checked::Valid(kind) = light.type_ else {
        return None;
    };
    let position = world.translation;
    if !super::within_reach(position) {
        return None;
    }
    let direction = world.transform_vector3(DVec3::NEG_Z).try_normalize();
    match kind {
        LightType::Directional => {
            Some(Light::Directional { direction: direction?, angular_diameter: 0.0 })
        }
        LightType::Point => Some(Light::Point { position }),
        LightType::Spot => {
            let outer_angle = f64::from(light.spot.as_ref()?.outer_cone_angle);
            let valid = outer_angle > 0.0 && outer_angle < std::f64::consts::FRAC_PI_2;
            valid.then_some(Light::Spot { position, direction: direction?, outer_angle })
        }
    }
}
