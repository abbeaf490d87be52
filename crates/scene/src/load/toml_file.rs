//! The scene description of this project; `docs/scene-files.md` describes every key.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::{DAffine3, DMat3, DVec3, EulerRot};
use serde::Deserialize;

use super::{LoadOptions, Repairs, has_ending, load_geometry, read_file, unreadable, within_reach};
use crate::light::basis;
use crate::{Camera, Instance, Light, LoadError, Scene};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SceneTable {
    name: Option<String>,
    #[serde(default)]
    mesh: Vec<MeshTable>,
    camera: Option<CameraTable>,
    #[serde(default)]
    light: Vec<LightTable>,
    ground: Option<GroundTable>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MeshTable {
    file: PathBuf,
    name: Option<String>,
    #[serde(default)]
    translate: DVec3,
    #[serde(default)]
    rotate: DVec3,
    scale: Option<Scale>,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected one number or three")]
enum Scale {
    Uniform(f64),
    PerAxis(DVec3),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraTable {
    eye: DVec3,
    target: DVec3,
    up: Option<DVec3>,
    fov_y: Option<f64>,
    near: Option<f64>,
}

#[derive(Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
enum LightTable {
    Directional {
        direction: DVec3,
        #[serde(default)]
        angular_diameter: f64,
    },
    Point {
        position: DVec3,
    },
    Spot {
        position: DVec3,
        direction: DVec3,
        outer_angle: f64,
    },
    Sphere {
        center: DVec3,
        radius: f64,
    },
    Rect {
        center: DVec3,
        half_u: DVec3,
        half_v: DVec3,
    },
    Disc {
        center: DVec3,
        radius: f64,
        normal: DVec3,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct GroundTable {
    height: Option<f64>,
    half_size: Option<f64>,
}

pub(super) fn load(
    path: &Path,
    options: &LoadOptions,
    repairs: &mut Repairs,
) -> Result<Scene, LoadError> {
    let bytes = read_file(path)?;
    let text = str::from_utf8(&bytes).map_err(|e| {
        unreadable(path, format!("is no UTF-8 text after byte {}", e.valid_up_to()))
    })?;
    let table: SceneTable = toml::from_str(text).map_err(|e| unreadable(path, e))?;
    let mut scene = Scene { name: table.name.unwrap_or_default(), ..Scene::default() };
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut known = HashMap::new();
    for (index, mesh) in table.mesh.iter().enumerate() {
        let transform = transform(mesh)
            .map_err(|fault| unreadable(path, format!("mesh {}: {fault}", index + 1)))?;
        let file = folder.join(&mesh.file);
        if has_ending(&file, &["toml"]) {
            return Err(unreadable(
                path,
                format!("mesh {}: `file` must name a .glb, .gltf or .obj file", index + 1),
            ));
        }
        add_file(&mut scene, &mut known, file, options, repairs, |instance| Instance {
            name: mesh.name.clone().unwrap_or(instance.name),
            mesh: instance.mesh,
            transform: transform * instance.transform,
        })
        .map_err(|error| match error {
            // What cannot be read at all is first of all a fault of the reference to it.
            LoadError::Unreadable { .. } | LoadError::UnknownFormat { .. } => {
                unreadable(path, format!("mesh {}: {error}", index + 1))
            }
            other => other,
        })?;
    }
    if let Some(camera) = &table.camera {
        let camera = read_camera(camera).map_err(|f| unreadable(path, format!("camera: {f}")))?;
        scene.camera = Some(camera);
    }
    for (index, light) in table.light.iter().enumerate() {
        let light = read_light(light)
            .map_err(|fault| unreadable(path, format!("light {}: {fault}", index + 1)))?;
        scene.lights.push(light);
    }
    if let Some(ground) = &table.ground {
        add_ground(&mut scene, ground)
            .map_err(|fault| unreadable(path, format!("ground: {fault}")))?;
    }
    Ok(scene)
}

/// Adds the instances of `file`, placed by `place`. A file named twice is read once, and its meshes
/// are shared.
fn add_file(
    scene: &mut Scene,
    known: &mut HashMap<PathBuf, Vec<Instance>>,
    file: PathBuf,
    options: &LoadOptions,
    repairs: &mut Repairs,
    place: impl Fn(Instance) -> Instance,
) -> Result<(), LoadError> {
    if !known.contains_key(&file) {
        let part = load_geometry(&file, options, repairs)?;
        let base = scene.meshes.len();
        scene.meshes.extend(part.meshes);
        scene.cutouts.extend(part.cutouts.into_iter().map(|(mesh, cut)| (mesh + base, cut)));
        scene.opacities.extend(part.opacities.into_iter().map(|(mesh, o)| (mesh + base, o)));
        let moved = part.instances.into_iter().map(|i| Instance { mesh: i.mesh + base, ..i });
        known.insert(file.clone(), moved.collect());
    }
    scene.instances.extend(known[&file].iter().cloned().map(place));
    Ok(())
}

fn transform(table: &MeshTable) -> Result<DAffine3, String> {
    let scale = match table.scale {
        None => DVec3::ONE,
        Some(Scale::Uniform(s)) => DVec3::splat(s),
        Some(Scale::PerAxis(s)) => s,
    };
    finite("translate", table.translate)?;
    finite("rotate", table.rotate)?;
    finite("scale", scale)?;
    let angles = table.rotate.map(f64::to_radians);
    // Extrinsic x, then y, then z: the matrix is Rz Ry Rx.
    let rotation = DMat3::from_euler(EulerRot::ZYX, angles.z, angles.y, angles.x);
    Ok(DAffine3 { matrix3: rotation * DMat3::from_diagonal(scale), translation: table.translate })
}

fn read_camera(table: &CameraTable) -> Result<Camera, String> {
    let camera = Camera {
        eye: place("eye", table.eye)?,
        target: place("target", table.target)?,
        up: unit("up", table.up.unwrap_or(DVec3::Y))?,
        fov_y: table.fov_y.unwrap_or(45.0).to_radians(),
        near: positive("near", table.near.unwrap_or(0.1))?,
    };
    if camera.eye == camera.target {
        return Err("`target` must differ from `eye`".to_owned());
    }
    if !(camera.fov_y > 0.0 && camera.fov_y < std::f64::consts::PI) {
        return Err("`fov_y` must lie between 0 and 180 degrees".to_owned());
    }
    Ok(camera)
}

fn read_light(table: &LightTable) -> Result<Light, String> {
    Ok(match *table {
        LightTable::Directional { direction, angular_diameter } => {
            let angular_diameter = angular_diameter.to_radians();
            if !(0.0..std::f64::consts::PI).contains(&angular_diameter) {
                return Err(
                    "`angular_diameter` must be at least 0 and below 180 degrees".to_owned()
                );
            }
            Light::Directional { direction: unit("direction", direction)?, angular_diameter }
        }
        LightTable::Point { position } => Light::Point { position: place("position", position)? },
        LightTable::Spot { position, direction, outer_angle } => {
            let outer_angle = outer_angle.to_radians();
            if !(outer_angle > 0.0 && outer_angle < std::f64::consts::FRAC_PI_2) {
                return Err("`outer_angle` must lie between 0 and 90 degrees".to_owned());
            }
            Light::Spot {
                position: place("position", position)?,
                direction: unit("direction", direction)?,
                outer_angle,
            }
        }
        LightTable::Sphere { center, radius } => {
            Light::Sphere { center: place("center", center)?, radius: size("radius", radius)? }
        }
        LightTable::Rect { center, half_u, half_v } => {
            let (u, v) = (unit("half_u", half_u)?, unit("half_v", half_v)?);
            // A thousandth of a radian: what remains of right angles typed with three decimals.
            if u.dot(v).abs() > 1e-3 {
                return Err("`half_u` and `half_v` must be at right angles".to_owned());
            }
            let half_v = half_v - u * half_v.dot(u);
            Light::Rect { center: place("center", center)?, half_u, half_v }
        }
        LightTable::Disc { center, radius, normal } => {
            let (axis_u, axis_v) = basis(unit("normal", normal)?);
            let (center, radius) = (place("center", center)?, size("radius", radius)?);
            Light::Disc { center, radius, axis_u, axis_v }
        }
    })
}

fn add_ground(scene: &mut Scene, table: &GroundTable) -> Result<(), String> {
    let bounds = scene.subject_bounds();
    if bounds.is_empty() {
        // Nothing to put a ground under; that the scene holds no triangle is reported later.
        return Ok(());
    }
    let height = table.height.unwrap_or(bounds.min.y);
    if !height.is_finite() {
        return Err("`height` must be a number".to_owned());
    }
    match table.half_size {
        Some(half) => scene.add_ground_at(height, positive("half_size", half)?),
        None => scene.add_ground_at(height, crate::frame::GROUND_RADII * bounds.radius()),
    }
    Ok(())
}

fn finite(key: &str, v: DVec3) -> Result<DVec3, String> {
    if v.is_finite() { Ok(v) } else { Err(format!("`{key}` must be three finite numbers")) }
}

fn place(key: &str, v: DVec3) -> Result<DVec3, String> {
    if within_reach(v) {
        Ok(v)
    } else {
        Err(format!("`{key}` must lie within {:e} m", super::REACH))
    }
}

fn unit(key: &str, v: DVec3) -> Result<DVec3, String> {
    // Scaled first, so that squares neither overflow nor vanish.
    let scaled = finite(key, v)? / v.abs().max_element();
    scaled.try_normalize().ok_or_else(|| format!("`{key}` must not be zero"))
}

fn positive(key: &str, value: f64) -> Result<f64, String> {
    if value > 0.0 && value <= super::REACH {
        Ok(value)
    } else {
        Err(format!("`{key}` is {value}; it must be greater than 0 and at most {:e}", super::REACH))
    }
}

fn size(key: &str, value: f64) -> Result<f64, String> {
    if value == 0.0 { Ok(0.0) } else { positive(key, value) }
}
