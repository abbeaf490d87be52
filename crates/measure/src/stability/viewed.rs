//! Cases that a camera makes hard: where the eye, the near plane and the far plane are.

use antumbra_gpu::{Gpu, Technique, ViewCamera};
use antumbra_scene::generate::shapes;
use antumbra_scene::{Camera, Light, Mesh, Scene};
use glam::{DAffine3, DVec3, DVec4, Vec3};

use crate::{MeasureError, Stage};

/// Side of the view, samples.
const VIEW: u32 = 64;

/// Room to either side of a shadow's edge, texels of the map on the receiver, in which nothing is judged: the widest
/// kernel that is tested reaches 3.5 texels an axis, half of the diagonal of 8 is more, and a map is at most a
/// little coarser than the ideal one.
pub(super) const BAND: f64 = 8.0;

/// A scene under a light, seen by a camera, with the truth where it is known.
pub(super) struct Viewed<'a> {
    pub(super) scene: &'a Scene,
    pub(super) light: &'a Light,
    pub(super) camera: Camera,
    /// Far plane, metres; infinite where there is none.
    pub(super) far: f64,
    /// Whether a point (world space, with its normal) is lit; `None` where it is not judged.
    pub(super) lit: &'a dyn Fn(DVec3, Vec3) -> Option<bool>,
}

impl Viewed<'_> {
    pub(super) fn wrong_share(
        &self,
        gpu: &Gpu,
        technique: &mut dyn Technique,
    ) -> Result<f64, MeasureError> {
        let (mut wrong, mut judged) = (0_u32, 0_u32);
        for (p, n, v) in self.seen(gpu, technique)? {
            if let Some(lit) = (self.lit)(p, n) {
                judged += 1;
                wrong += u32::from(!is_right(v, lit));
            }
        }
        Ok(f64::from(wrong) / f64::from(judged))
    }

    /// Distance of the farthest wrong sample from the shadow's edge, which is `off` away from a point, > 0 in the light;
    /// in texels of `texel` metres.
    fn farthest_wrong(
        &self,
        gpu: &Gpu,
        technique: &mut dyn Technique,
        (texel, off): (f64, &dyn Fn(DVec3) -> f64),
    ) -> Result<f64, MeasureError> {
        // NaN where there was nothing to judge.
        let mut farthest = f64::NAN;
        for (p, n, v) in self.seen(gpu, technique)? {
            if let Some(lit) = (self.lit)(p, n) {
                let wrong = if is_right(v, lit) { 0.0 } else { off(p).abs() / texel };
                farthest = wrong.max(farthest);
            }
        }
        Ok(farthest)
    }

    /// The samples that the camera sees, with the light that they get.
    fn seen(
        &self,
        gpu: &Gpu,
        technique: &mut dyn Technique,
    ) -> Result<Vec<(DVec3, Vec3, f32)>, MeasureError> {
        let mut clip = self.camera.view_projection(DVec3::ZERO, 1.0);
        if self.far.is_finite() {
            // z = n (w_in) becomes n (f - d) / (f - n), reversed: 1 at n, 0 at f.
            let (n, f) = (self.camera.near, self.far);
            let mut rows = clip.transpose();
            rows.z_axis = (DVec4::W * f - rows.w_axis) * (n / (f - n));
            clip = rows.transpose();
        }
        let view = ViewCamera { clip, eye: self.camera.eye };
        let stage = Stage::seen_by(gpu, self.scene, &view, VIEW, VIEW)?;
        let shot = stage.shoot(gpu, self.light, technique, 0)?;
        let samples = stage.view_samples().into_iter().zip(shot.visibility);
        let there = samples.filter(|(sample, _)| sample.normal != Vec3::ZERO);
        Ok(there.map(|(s, v)| (s.position.as_dvec3(), s.normal, v)).collect())
    }
}

/// Asked this way round, NaN is wrong.
fn is_right(v: f32, lit: bool) -> bool {
    if lit { v > 0.5 } else { v <= 0.5 }
}

pub(super) fn camera(eye: DVec3, target: DVec3, near: f64) -> Camera {
    Camera { eye, target, up: DVec3::Y, fov_y: std::f64::consts::FRAC_PI_2, near }
}

/// Whether floor points are lit that a square of half side `half` (on the floor) about the origin shadows, judged
/// outside a band around its edge.
fn square_shadow(half: f64, band: f64) -> impl Fn(DVec3, Vec3) -> Option<bool> {
    move |p, n| {
        let out = p.x.abs().max(p.z.abs()) - half;
        (p.y.abs() < 1e-3 && n.y > 0.9 && out.abs() > band).then_some(out > 0.0)
    }
}

fn plate_over_floor(half: f64, height: f64) -> Scene {
    let mut scene = Scene::default();
    scene.add(shapes::floor(20.0), DAffine3::IDENTITY);
    scene
        .add(shapes::quad(height * DVec3::Y, half * DVec3::Z, half * DVec3::X), DAffine3::IDENTITY);
    scene
}

/// HC-15: the eye 1 m above the floor in the shadow of a plate of 10 m at 5 m, under a lamp at 20 m. Off the middle,
/// where the plate's two triangles meet.
pub(super) fn eye_in_shadow(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    let scene = plate_over_floor(5.0, 5.0);
    // The shadow is 4 / 3 times the plate.
    let band = BAND * 10.0 / f64::from(map_size) * 4.0 / 3.0;
    Viewed {
        scene: &scene,
        light: &Light::Point { position: 20.0 * DVec3::Y },
        camera: camera(DVec3::new(0.5, 1.0, 0.0), DVec3::new(0.5, 0.5, -1.0), 0.1),
        far: f64::INFINITY,
        lit: &square_shadow(20.0 / 3.0, band),
    }
    .wrong_share(gpu, technique)
}

/// HC-16: half of the floor lies in the shadow of a plate under a sun overhead, and the eye moves across the boundary,
/// upright and rolled. The largest share of wrong samples of all pictures. `on_boundary`: the one picture with
/// the eye exactly on it.
pub(super) fn boundary_at_eye(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
    on_boundary: bool,
) -> Result<f64, MeasureError> {
    let mut scene = Scene::default();
    scene.add(shapes::floor(20.0), DAffine3::IDENTITY);
    scene.add(
        shapes::quad(DVec3::new(-5.0, 5.0, 0.0), 10.0 * DVec3::Z, 5.0 * DVec3::X),
        DAffine3::IDENTITY,
    );
    let band = BAND * 20.0 / f64::from(map_size);
    let lit = move |p: DVec3, n: Vec3| {
        let judged = p.y.abs() < 1e-3 && n.y > 0.9 && p.x.abs() > band && p.z > -10.0 + band;
        // Nearer than its far edge, and not beyond its other one.
        (judged && p.x > -10.0 + band).then_some(p.x > 0.0)
    };
    let moves: &[f64] = if on_boundary { &[0.0] } else { &[-0.05, -0.001, 0.001, 0.05] };
    let mut worst = 0.0_f64;
    for &x in moves {
        for roll in [0.0_f64, 30.0] {
            let (sin, cos) = roll.to_radians().sin_cos();
            let mut camera = camera(DVec3::new(x, 1.0, 0.0), DVec3::new(x, 0.5, -1.0), 0.1);
            camera.up = DVec3::new(sin, cos, 0.0);
            let viewed = Viewed {
                scene: &scene,
                light: &Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 },
                camera,
                far: f64::INFINITY,
                lit: &lit,
            };
            worst = worst.max(viewed.wrong_share(gpu, technique)?);
        }
    }
    Ok(worst)
}

/// HC-17: a cube 44 m off casts its shadow on a wall that stands just before the camera's far plane at 50 m, from a
/// lamp behind the camera: the volumes go on beyond the far plane.
pub(super) fn beyond_far_plane(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    let light = DVec3::new(0.0, 5.0, 3.0);
    let mut scene = Scene::default();
    scene.add(shapes::floor(60.0), DAffine3::IDENTITY);
    scene.add(
        shapes::cuboid(DVec3::new(-1.0, 0.0, -46.0), DVec3::new(1.0, 2.0, -44.0)),
        DAffine3::IDENTITY,
    );
    scene.add(
        shapes::quad(DVec3::new(0.0, 4.0, -49.0), 4.0 * DVec3::X, 4.0 * DVec3::Y),
        DAffine3::IDENTITY,
    );
    // As the lamp sees them, the casters reach from the wall's top to the cube's foot, which it sees 8.5 m below that on the
    // wall.
    let texel = (3.0 / 52.0 + 5.0 / 47.0) * 52.0 / f64::from(map_size);
    let off = move |p: DVec3| {
        // Where the ray from the lamp meets the planes of the cube's front and back, and by how much it misses both; on the
        // wall that is as much farther as the wall is.
        let at = |z: f64| light + (p - light) * ((z - light.z) / (p.z - light.z));
        let out = |q: DVec3| q.x.abs().max((q.y - 1.0).abs()) - 1.0;
        out(at(-44.0)).min(out(at(-46.0))) * 52.0 / 47.0
    };
    let lit = |p: DVec3, n: Vec3| {
        ((p.z + 49.0).abs() < 1e-3 && n.z > 0.9 && p.y > 0.0).then(|| off(p) > 0.0)
    };
    let mut eye = camera(DVec3::new(3.0, 2.0, 0.0), DVec3::new(0.0, 2.0, -49.0), 0.1);
    eye.fov_y = 15_f64.to_radians();
    Viewed {
        scene: &scene,
        light: &Light::Point { position: light },
        camera: eye,
        far: 50.0,
        lit: &lit,
    }
    .farthest_wrong(gpu, technique, (texel, &off))
}

/// HC-18: a stack of sheets of 2 m over a floor, under a sun overhead.
pub(super) fn sheets(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
    counts: &[u32],
) -> Result<f64, MeasureError> {
    let mut worst = 0.0_f64;
    for &count in counts {
        let mut scene = Scene::default();
        scene.add(shapes::floor(10.0), DAffine3::IDENTITY);
        for i in 0..count {
            let center = DVec3::Y * (2.0 + 0.01 * f64::from(i));
            scene.add(shapes::quad(center, DVec3::Z, DVec3::X), DAffine3::IDENTITY);
        }
        let viewed = Viewed {
            scene: &scene,
            light: &Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 },
            camera: camera(DVec3::new(1.7, 1.5, 2.0), DVec3::ZERO, 0.1),
            far: f64::INFINITY,
            lit: &square_shadow(1.0, BAND * 2.0 / f64::from(map_size)),
        };
        worst = worst.max(viewed.wrong_share(gpu, technique)?);
    }
    Ok(worst)
}

/// HC-21: a triangle in whose plane the lamp lies, and slivers of 100 m by 0.1 mm that it sees all but edge-on. Nothing
/// of that shadows the floor.
pub(super) fn light_in_plane(
    gpu: &Gpu,
    technique: &mut dyn Technique,
) -> Result<f64, MeasureError> {
    let triangle = |corners: [[f32; 3]; 3]| Mesh {
        name: "triangle".to_owned(),
        positions: corners.map(Vec3::from_array).to_vec(),
        triangles: vec![[0, 1, 2]],
    };
    let mut scene = Scene::default();
    scene.add(shapes::floor(20.0), DAffine3::IDENTITY);
    scene.add(triangle([[0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 1.0]]), DAffine3::IDENTITY);
    for off in [1e-6_f32, -1e-6] {
        scene.add(
            triangle([
                [-50.0, 1.0 + off, -2.0],
                [50.0, 1.0 + off, -2.0],
                [50.0, 1.0 + off, -2.0001],
            ]),
            DAffine3::IDENTITY,
        );
    }
    Viewed {
        scene: &scene,
        light: &Light::Point { position: DVec3::new(5.0, 1.0, 5.0) },
        camera: camera(DVec3::new(0.3, 3.0, 6.0), DVec3::ZERO, 0.1),
        far: f64::INFINITY,
        lit: &|p, n| (p.y.abs() < 1e-3 && n.y > 0.9).then_some(true),
    }
    .wrong_share(gpu, technique)
}

/// HC-23: the lamp at the eye, where no shadow is seen, or in the near plane beside the axis.
pub(super) fn light_at_eye(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
    on_near_plane: bool,
) -> Result<f64, MeasureError> {
    let scene = plate_over_floor(1.0, 2.0);
    let near = 0.1;
    let eye = camera(DVec3::new(0.0, 6.0, 0.0), DVec3::ZERO, near);
    let light = if on_near_plane { DVec3::new(0.25, 6.0 - near, 0.0) } else { eye.eye };
    // The plate is seen from (h - 2) / h of its shadow's size.
    let height = light.y;
    let center = -light.with_y(0.0) * (2.0 / (height - 2.0));
    let half = height / (height - 2.0);
    let (shadow, texel) = (square_shadow(half, 0.0), 2.0 * half / f64::from(map_size));
    let off = |p: DVec3| (p - center).x.abs().max((p - center).z.abs()) - half;
    Viewed {
        scene: &scene,
        light: &Light::Point { position: light },
        camera: eye,
        far: f64::INFINITY,
        lit: &|p, n| shadow(p - center, n),
    }
    .farthest_wrong(gpu, technique, (texel, &off))
}

/// HC-24: lamps where geometry degenerates: in a closed cube, whose outside is dark, and at a corner of a triangle, which
/// is then edge-on, over a lit floor.
pub(super) fn light_in_geometry(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    inside_cube: bool,
) -> Result<f64, MeasureError> {
    let mut scene = Scene::default();
    scene.add(shapes::floor(10.0), DAffine3::IDENTITY);
    let light = DVec3::new(0.0, 2.0, 0.0);
    if inside_cube {
        scene.add(shapes::cuboid(light - DVec3::ONE, light + DVec3::ONE), DAffine3::IDENTITY);
    } else {
        let corners = [light, light + DVec3::new(0.5, 0.5, 0.0), light + DVec3::new(0.0, 0.5, 0.5)];
        let mesh = Mesh {
            name: "triangle".to_owned(),
            positions: corners.map(|c| c.as_vec3()).to_vec(),
            triangles: vec![[0, 1, 2]],
        };
        scene.add(mesh, DAffine3::IDENTITY);
    }
    Viewed {
        scene: &scene,
        light: &Light::Point { position: light },
        camera: camera(DVec3::new(3.0, 4.0, 5.0), DVec3::ZERO, 0.1),
        far: f64::INFINITY,
        lit: &|p, n| (p.y.abs() < 1e-3 && n.y > 0.9).then_some(!inside_cube),
    }
    .wrong_share(gpu, technique)
}

/// HC-25: the plate of HC-01 stands before the camera's near plane, so that the camera looks through it.
pub(super) fn caster_not_seen(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    let scene = plate_over_floor(1.0, 2.0);
    // Down along -y, the plate 2 m below the eye, the near plane 3 m.
    Viewed {
        scene: &scene,
        light: &Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 },
        camera: camera(DVec3::new(0.3, 4.0, 0.2), DVec3::new(0.3, 0.0, 0.2), 3.0),
        far: f64::INFINITY,
        lit: &square_shadow(1.0, BAND * 2.0 / f64::from(map_size)),
    }
    .wrong_share(gpu, technique)
}
