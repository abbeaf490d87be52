//! Depth peeling against ray casting: every surface behind a texel, once, in order.

use antumbra_gpu::{Frame, Gpu, GpuError, Recorder, read_f32_texture};
use antumbra_map::{CasterDepth, DepthPeel, Faces, Omni, PolygonOffset, ShadowMap};
use antumbra_measure::Stage;
use antumbra_scene::generate::shapes;
use antumbra_scene::{Light, Scene};
use antumbra_tests::gpu;
use glam::{DAffine3, DMat4, DVec2, DVec3};

use crate::shared::reticent::Reticent;

/// Side of a map, texels.
const SIZE: u32 = 96;

/// The layers behind each view of a light: `layers[view][depth][texel]`, with the view's matrix.
struct Peeled {
    views: Vec<(DMat4, Vec<Vec<f32>>)>,
}

fn peel(gpu: &Gpu, frame: &Frame<'_>, deeper: u32) -> Result<Peeled, GpuError> {
    let mut map = ShadowMap::new(gpu, SIZE, 2, Box::new(Omni::Cube))?;
    let depth = CasterDepth::new(gpu, Faces::Both, PolygonOffset::default())?;
    let mut peel = DepthPeel::new(gpu, deeper)?;
    map.prepare(gpu, frame)?;
    peel.prepare(gpu, frame, &map)?;
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let mut recorder = Recorder::new(&mut encoder);
    map.encode_triangles(frame, &mut recorder, &depth)?;
    peel.encode(gpu, frame, &map, &mut recorder)?;
    gpu.queue.submit([encoder.finish()]);
    let mut views = Vec::new();
    for (layer, clip) in map.views().iter().filter_map(|v| v.clip).enumerate() {
        let first = map.texture().expect("a map with casters");
        let mut layers = vec![read_f32_texture(gpu, first, layer as u32)?];
        for depth in 0..deeper as usize {
            let (texture, _) = peel.layer(depth).expect("as many layers as asked for");
            layers.push(read_f32_texture(gpu, texture, layer as u32)?);
        }
        views.push((clip.as_mat4().as_dmat4(), layers));
    }
    assert_eq!(peel.counters()["peel_passes"], u64::from(deeper) * views.len() as u64, "passes");
    Ok(Peeled { views })
}

/// What rays through a texel's centre meet: depths, nearest first, each with how far the rasteriser's snap of
/// vertices can move it; `None` where that could decide whether a triangle is met.
fn cast(triangles: &[[(DVec2, f64); 3]], center: DVec2) -> Option<Vec<(f64, f64)>> {
    // A vertex moves by at most 1/256 texel an axis: an edge by at most sqrt(2) / 256.
    const SNAP: f64 = std::f64::consts::SQRT_2 / 256.0;
    let mut hits = Vec::new();
    for corners in triangles {
        let p = corners.map(|(p, _)| p);
        let area = (p[1] - p[0]).perp_dot(p[2] - p[0]);
        let sides = [0, 1, 2].map(|i| {
            let edge = p[(i + 1) % 3] - p[i];
            edge.perp_dot(center - p[i]) * area.signum() / edge.length()
        });
        let least = sides.into_iter().fold(f64::INFINITY, f64::min);
        if least.abs() <= SNAP {
            return None;
        }
        if least > 0.0 {
            let weight =
                |i: usize| (p[(i + 1) % 3] - center).perp_dot(p[(i + 2) % 3] - center) / area;
            let depth = (0..3).map(|i| weight(i) * corners[i].1).sum::<f64>();
            // The plane's slope, and so what a move to the side does to depth.
            let (u, v) = (p[1] - p[0], p[2] - p[0]);
            let (du, dv) = (corners[1].1 - corners[0].1, corners[2].1 - corners[0].1);
            let slope = DVec2::new(v.y * du - u.y * dv, u.x * dv - v.x * du) / area;
            hits.push((depth, (slope.x.abs() + slope.y.abs()) / 256.0 + 1e-6));
        }
    }
    hits.sort_by(|a, b| b.0.total_cmp(&a.0));
    Some(hits)
}

/// Outcome of comparing layers with rays.
#[derive(Debug, Default)]
struct Agreement {
    /// Texels that were judged.
    texels: usize,
    /// Of these, those with at least three layers.
    deep: usize,
    /// Texels whose number of layers, or a depth of them, is wrong.
    wrong: usize,
    /// Texels in which a layer is not strictly beyond the one before.
    unordered: usize,
}

fn agreement(stage: &Stage, peeled: &Peeled) -> Agreement {
    let size = f64::from(SIZE);
    let mut found = Agreement::default();
    for (clip, layers) in &peeled.views {
        let project = |i: u32| {
            let p = stage.triangles.positions[i as usize].as_dvec3();
            let c = *clip * p.extend(1.0);
            assert!(c.w > 0.0, "the bodies stand in front of the light");
            let ndc = c.truncate() / c.w;
            ((DVec2::splat(0.5) + DVec2::new(0.5, -0.5) * ndc.truncate()) * size, ndc.z)
        };
        let triangles: Vec<_> = stage.triangles.triangles.iter().map(|t| t.map(project)).collect();
        for texel in 0..SIZE * SIZE {
            let column: Vec<f32> = layers.iter().map(|l| l[texel as usize]).collect();
            let unordered = column.windows(2).any(|w| w[0] != 0.0 && w[1] >= w[0]);
            found.unordered += usize::from(unordered);
            let center = DVec2::new(f64::from(texel % SIZE), f64::from(texel / SIZE)) + 0.5;
            let Some(hits) = cast(&triangles, center) else { continue };
            // Crossings nearer to each other than they are known could be one layer or come in another order.
            if hits.windows(2).any(|w| w[0].0 - w[1].0 <= w[0].1 + w[1].1) {
                continue;
            }
            found.texels += 1;
            found.deep += usize::from(hits.len() >= 3);
            let right = column.iter().enumerate().all(|(i, z)| match hits.get(i) {
                Some((depth, error)) => (f64::from(*z) - depth).abs() <= *error,
                None => *z == 0.0,
            });
            found.wrong += usize::from(!right);
        }
    }
    found
}

fn stage(gpu: &Gpu, scene: &Scene) -> Stage {
    let mut stage = Stage::new(gpu, scene, scene.framing_camera(), 16, 16).expect("a stage");
    stage.meshes.set_culling(false);
    stage
}

/// A sphere, a box in it that sticks out, and a plate across both.
fn bodies(with_box: bool) -> Scene {
    let mut scene = Scene::default();
    scene.add(shapes::icosphere(2, 1.0), DAffine3::from_rotation_x(0.4));
    if with_box {
        let half = DVec3::new(0.3, 1.6, 0.4);
        scene.add(shapes::cuboid(-half, half), DAffine3::from_rotation_z(0.7));
    }
    let plate = shapes::quad(DVec3::ZERO, DVec3::new(1.5, 0.3, 0.0), DVec3::new(0.0, 0.2, 1.5));
    scene.add(plate, DAffine3::IDENTITY);
    scene
}

fn lights() -> [Light; 3] {
    let direction = DVec3::new(0.3, -1.0, 0.2).normalize();
    [
        Light::Directional { direction, angular_diameter: 0.0 },
        Light::Spot { position: -6.0 * direction, direction, outer_angle: 0.4 },
        Light::Point { position: DVec3::new(-4.0, 3.0, 3.5) },
    ]
}

#[test]
fn layers_of_bodies_are_what_rays_meet() {
    let gpu = gpu();
    let (all, without_box) = (stage(&gpu, &bodies(true)), stage(&gpu, &bodies(false)));
    for light in &lights() {
        let peeled = peel(&gpu, &all.frame(light), 7).expect("peeled");
        let found = agreement(&all, &peeled);
        assert!(found.texels > 5000 && found.deep > 1000, "{light:?}: {found:?}");
        assert_eq!((found.wrong, found.unordered), (0, 0), "{light:?}: {found:?}");
        // The controls: layers of other bodies, and a layer left out, must not pass.
        let other = agreement(&without_box, &peeled);
        assert!(other.wrong > 500, "{light:?}: other bodies pass, {other:?}");
        let mut skipped = peeled;
        for (_, layers) in &mut skipped.views {
            layers.remove(1);
        }
        let skipped = agreement(&all, &skipped);
        assert!(skipped.wrong > 1000, "{light:?}: a missing layer passes, {skipped:?}");
    }
}

#[test]
fn stacked_sheets_come_one_by_one_and_doubled_ones_once() {
    let gpu = gpu();
    let heights = [3.0, 1.0, 5.0, 2.0, 4.0, 3.0];
    let mut scene = Scene::default();
    for height in heights {
        scene.add(shapes::quad(height * DVec3::Y, DVec3::Z, DVec3::X), DAffine3::IDENTITY);
    }
    let stage = stage(&gpu, &scene);
    let light = Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 };
    let peeled = peel(&gpu, &stage.frame(&light), 5).expect("peeled");
    let (clip, layers) = &peeled.views[0];
    for (depth, layer) in layers.iter().enumerate() {
        let texel = layer[(SIZE * SIZE / 2 + SIZE / 2) as usize];
        // Sheets at 5, 4, .. 1, of which 3 is there twice; the sixth layer is empty.
        let expected = match depth {
            0..=4 => {
                let p = (5.0 - depth as f64) * DVec3::Y - stage.triangles.origin;
                clip.project_point3(p).z
            }
            _ => 0.0,
        };
        assert!((f64::from(texel) - expected).abs() <= 1e-6, "layer {depth}: {texel}, {expected}");
        let same = layer.iter().filter(|z| **z == texel).count();
        let filled = layers[0].iter().filter(|z| **z != 0.0).count();
        let everywhere = if depth == 5 { SIZE as usize * SIZE as usize } else { filled };
        assert_eq!(same, everywhere, "a level sheet has one depth, layer {depth}");
    }
}

#[test]
fn two_runs_give_the_same_bits() {
    let gpu = gpu();
    let stage = stage(&gpu, &bodies(true));
    for light in &lights() {
        let layers = || peel(&gpu, &stage.frame(light), 3).expect("peeled").views;
        assert_eq!(layers(), layers(), "{light:?}");
    }
}

#[test]
fn casters_without_triangles_are_refused_with_a_fix() {
    let gpu = gpu();
    let stage = stage(&gpu, &bodies(true));
    let light = &lights()[0];
    let reticent = Reticent(&stage.meshes);
    let frame = Frame { casters: &reticent, ..stage.frame(light) };
    let error = peel(&gpu, &frame, 1).err().expect("refused");
    assert!(matches!(error, GpuError::Invalid { .. }), "{error}");
    assert!(error.to_string().contains("map/plain"), "the fix is missing from: {error}");
}
