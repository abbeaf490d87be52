//! Flat casters over a floor, whose shadows have a closed form: how far from the edge anything is wrong.

use antumbra_gpu::{Gpu, Technique};
use antumbra_reference::ViewSample;
use antumbra_reference::closed::{Occluder, shadow_margin};
use antumbra_scene::generate::{self, RectOverPlane, shapes};
use antumbra_scene::{Light, Mesh, Scene};
use glam::{DAffine3, DVec2, DVec3, Vec3};

use super::unit_cube;
use crate::{MeasureError, Stage};

/// Samples of the floor: half of them all over it, half near the shadow's edge.
const SAMPLES: usize = 1 << 16;
/// Half side of the floor of HC-01 and HC-02, metres.
const FLOOR_HALF: f64 = 10.0;
/// Texels to either side of the edge in which the nearer half of the samples lies.
const BAND: f64 = 16.0;
/// A filter's weights add up to 1 within the rounding of its terms: 2^-24 each, of 64 at most here,
/// and as much again for fractions kept to as many bits.
const ROUNDING: f64 = 1e-5;

/// A flat caster over the floor.
pub(super) struct FlatCaster {
    pub(super) scene: Scene,
    pub(super) light: Light,
    pub(super) corners: Vec<DVec3>,
    normal: DVec3,
    /// Side of a texel of the ideal map in the caster's plane, metres.
    pub(super) texel: f64,
}

/// HC-01 under one of its lights: C, B, A in the scene's order.
pub(super) fn square(light: usize, map_size: u32) -> FlatCaster {
    let scene = generate::rectangle_over_plane(&RectOverPlane::default());
    FlatCaster {
        light: scene.lights[light],
        corners: square_corners(&DAffine3::IDENTITY),
        normal: DVec3::Y,
        // The square fills the map: 2 m a side.
        texel: 2.0 / f64::from(map_size),
        scene,
    }
}

fn square_corners(turn: &DAffine3) -> Vec<DVec3> {
    [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
        .map(|(x, z)| turn.transform_point3(DVec3::new(x, 2.0, z)))
        .to_vec()
}

/// HC-01 B with the square turned by 30 degrees.
pub(super) fn turned_square(map_size: u32) -> FlatCaster {
    let angle = 30_f64.to_radians();
    let turn = DAffine3::from_rotation_y(angle);
    let mut scene = Scene::default();
    scene.add(shapes::floor(FLOOR_HALF), DAffine3::IDENTITY);
    scene.add(shapes::quad(2.0 * DVec3::Y, DVec3::Z, DVec3::X), turn);
    FlatCaster {
        scene,
        light: Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 },
        corners: square_corners(&turn),
        normal: DVec3::Y,
        // The box around the turned square is 2 (cos 30 + sin 30) m wide.
        texel: 2.0 * (angle.cos() + angle.sin()) / f64::from(map_size),
    }
}

/// HC-02: a point light 1 m above the floor, and a triangle 2 m off from y = 0.5 to y = 2.
pub(super) fn rising_triangle(map_size: u32) -> FlatCaster {
    let corners =
        vec![DVec3::new(-1.0, 0.5, -2.0), DVec3::new(1.0, 0.5, -2.0), DVec3::new(0.0, 2.0, -2.0)];
    let triangle = Mesh {
        name: "triangle".to_owned(),
        positions: corners.iter().map(|c| c.as_vec3()).collect(),
        triangles: vec![[0, 1, 2]],
    };
    let mut scene = Scene::default();
    scene.add(shapes::floor(FLOOR_HALF), DAffine3::IDENTITY);
    scene.add(triangle, DAffine3::IDENTITY);
    FlatCaster {
        scene,
        light: Light::Point { position: DVec3::Y },
        corners,
        normal: DVec3::Z,
        // The box around the triangle is 2 m wide and 1.5 m high.
        texel: 2.0 / f64::from(map_size),
    }
}

impl FlatCaster {
    /// The distance, in texels in the caster's plane, of the farthest wrong sample from the shadow's edge;
    /// 0 where nothing is wrong.
    pub(super) fn farthest_wrong(
        &self,
        gpu: &Gpu,
        technique: &mut dyn Technique,
    ) -> Result<f64, MeasureError> {
        self.farthest_wrong_of(gpu, technique, &self.stage(gpu)?, &self.light)
    }

    /// The scene at samples of the floor.
    pub(super) fn stage(&self, gpu: &Gpu) -> Result<Stage, MeasureError> {
        Stage::at_points(gpu, &self.scene, &self.floor_samples())
    }

    /// As [`FlatCaster::farthest_wrong`], of the samples of `stage`, all of them on the floor, under `light`.
    pub(super) fn farthest_wrong_of(
        &self,
        gpu: &Gpu,
        technique: &mut dyn Technique,
        stage: &Stage,
        light: &Light,
    ) -> Result<f64, MeasureError> {
        let shot = stage.shoot(gpu, light, technique, 0)?;
        let mut farthest = 0.0_f64;
        for (point, v) in stage.view_samples().iter().zip(&shot.visibility) {
            if point.normal == Vec3::ZERO {
                continue;
            }
            let p = stage.triangles.origin + point.position.as_dvec3();
            let margin = self.margin(light, p);
            let truth = if margin > 0.0 { 0.0 } else { 1.0 };
            let right = (f64::from(*v) - truth).abs() <= ROUNDING;
            // Asked this way round, NaN is wrong.
            if !right {
                // The margin is the distance in the caster's plane times this cosine.
                let ray = light.towards(p, DVec2::splat(0.5)).normalize();
                farthest = farthest.max(margin.abs() / self.normal.dot(ray).abs());
            }
        }
        Ok(farthest / self.texel)
    }

    /// How far `p` is from the shadow's edge, metres, positive in shadow.
    pub(super) fn margin(&self, light: &Light, p: DVec3) -> f64 {
        shadow_margin(&Occluder::ConvexPolygon(self.corners.clone()), light, p)
    }

    fn floor_samples(&self) -> Vec<ViewSample> {
        let anywhere =
            |[a, b, _]: [f64; 3]| DVec3::new(2.0 * a - 1.0, 0.0, 2.0 * b - 1.0) * FLOOR_HALF;
        let near_edge = |[a, b, c]: [f64; 3]| {
            let along = c * self.corners.len() as f64;
            let edge = along as usize;
            let (from, to) = (self.corners[edge], self.corners[(edge + 1) % self.corners.len()]);
            let (u, v) = ((to - from).normalize(), self.normal.cross(to - from).normalize());
            let aside = u * (2.0 * a - 1.0) + v * (2.0 * b - 1.0);
            self.cast(from.lerp(to, along.fract()) + aside * (BAND * self.texel))
        };
        let on_floor = |p: &DVec3| p.x.abs() <= FLOOR_HALF && p.z.abs() <= FLOOR_HALF;
        let points =
            unit_cube(SAMPLES / 2).flat_map(|unit| [Some(anywhere(unit)), near_edge(unit)]);
        points
            .flatten()
            .filter(on_floor)
            .map(|p| ViewSample { position: p.as_vec3(), normal: Vec3::Y })
            .collect()
    }

    /// Where the light casts `q` onto the floor, if it does.
    fn cast(&self, q: DVec3) -> Option<DVec3> {
        cast(&self.light, q)
    }
}

/// Where `light` casts `q` onto the floor, if it does.
pub(super) fn cast(light: &Light, q: DVec3) -> Option<DVec3> {
    let away = -light.towards(q, DVec2::splat(0.5));
    (away.y < 0.0).then(|| (q - away * (q.y / away.y)).with_y(0.0))
}
