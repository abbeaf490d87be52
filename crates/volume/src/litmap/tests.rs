//! What a litmap says against all pairs of samples and triangles, in f64.

use antumbra_gpu::{GpuOptions, read_buffer};
use antumbra_measure::Stage;
use antumbra_scene::{Camera, Light, LightKind, Scene, generate};
use glam::DVec3;

use super::*;
use crate::light::{contact, homogeneous_light};
use crate::twin::Volume;

#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
struct Limit {
    columns: u32,
    rows: u32,
    near: f32,
    far: f32,
}

fn limits(gpu: &Gpu, stage: &Stage, light: &Light, savings: Savings, bodies: bool) -> Vec<Limit> {
    let frame = stage.frame(light);
    let triangles = frame.casters.triangles().expect("triangles");
    let edges = frame.casters.edges(gpu).expect("edges").expect("edges");
    let count = if bodies { edges.body_count } else { triangles.triangles };
    let mut litmap = Litmap::new(gpu, savings).expect("a litmap");
    let request = LitmapRequest {
        samples: &stage.samples,
        volumes: count,
        light: homogeneous_light(&frame),
        contact: contact(&frame),
        edges: edges.count,
    };
    litmap.prepare(gpu, &request).expect("prepared");
    let limits = storage(gpu, "limits", 16 * u64::from(count)).expect("a buffer");
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let mut recorder = Recorder::new(&mut encoder);
    litmap.encode(gpu, &mut recorder, &triangles, Some(edges), bodies, &limits);
    gpu.queue.submit([encoder.finish()]);
    let bytes = read_buffer(gpu, &limits, 16 * u64::from(count)).expect("read back");
    bytemuck::pod_collect_to_vec(&bytes)
}

const SIDE: u32 = 64;

fn stage(gpu: &Gpu, scene: &Scene, camera: Camera) -> Stage {
    Stage::new(gpu, scene, camera, SIDE, SIDE).expect("a stage")
}

/// What limits got wrong, and whether they said anything.
#[derive(Debug, Default)]
struct Verdict {
    /// Samples that the limits of a volume leave out that holds them, by a band or by the end; with hidden casters, if those of
    /// all do. A caster may be hidden in one layer of the map and not in another.
    missed: usize,
    /// Pairs of samples and volumes that hold them.
    inside: usize,
    /// Volumes without a band, of those that there are.
    without: usize,
    volumes: usize,
}

fn judge(gpu: &Gpu, stage: &Stage, light: &Light, limits: &[Limit], hidden: bool) -> Verdict {
    let at = homogeneous_light(&stage.frame(light)).as_dvec4();
    let touch = 2.0 * f64::from(contact(&stage.frame(light)));
    // In the order of the GPU.
    let (positions, triangles) = stage.meshes.geometry(gpu).expect("read back");
    let point = |i: u32| positions[i as usize].as_dvec3();
    let volume = |t: &[u32; 3]| Volume::new(at, t.map(point));
    let volumes: Vec<(usize, Volume)> =
        triangles.iter().enumerate().filter_map(|(i, t)| Some((i, volume(t)?))).collect();
    let mut verdict = Verdict {
        without: volumes.iter().filter(|(i, ..)| limits[*i].columns == 0).count(),
        volumes: volumes.len(),
        ..Verdict::default()
    };
    for (i, sample) in stage.view_samples().into_iter().enumerate().step_by(3) {
        let p = sample.position.as_dvec3();
        let to = at.truncate() - p * at.w;
        if sample.normal.as_dvec3().dot(to) <= 0.0 {
            continue;
        }
        let (x, y) = (i as u32 % SIDE / 2, i as u32 / SIDE / 2);
        let (mut kept, mut left_out, mut inside) = (false, false, 0);
        for (index, volume) in &volumes {
            let d = volume.distances(p);
            let sides = d[0].max(d[1]).max(d[2]);
            if sides > 1e-9 || d[3] > -touch {
                continue;
            }
            // Where on its way to the light the triangle is, and how far along the light from there the sample.
            let s = -d[3] / (volume.distances(p + to)[3] - d[3]);
            let t = if at.w == 0.0 { s } else { s / (1.0 - s) };
            let limit = limits[*index];
            let banded = limit.columns >> x & 1 == 1 && limit.rows >> y & 1 == 1;
            let holds = banded && (limit.far == 0.0 || f64::from(limit.far) >= t);
            // On the side that two triangles share, one of them is enough; what is at the rim is for the doubtful.
            kept |= holds;
            if sides < 0.0 && d[3] < -1e-4 {
                inside += 1;
                left_out |= !holds;
            }
        }
        verdict.inside += inside;
        // Without hidden casters no volume may be left out; with them, not all of a sample.
        verdict.missed += usize::from(left_out && !(hidden && kept));
    }
    verdict
}

fn scenes() -> [Scene; 3] {
    [
        generate::street(),
        generate::by_name("sphere").expect("a scene"),
        generate::by_name("hall").expect("a scene"),
    ]
}

#[test]
fn no_sample_is_missed_and_what_is_hidden_others_shadow() {
    let gpu = Gpu::new(&GpuOptions::default()).unwrap_or_else(|e| panic!("{e}"));
    let mut sums = [[0; 2]; 2];
    for scene in scenes() {
        let stage = stage(&gpu, &scene, scene.camera_or_framing());
        for kind in [LightKind::Directional, LightKind::Point] {
            let light = scene.light_or_placed(kind);
            for (i, hidden) in [false, true].into_iter().enumerate() {
                let savings = Savings { litmap: 128, hidden, ..Savings::WINDOW };
                let limits = limits(&gpu, &stage, &light, savings, false);
                let verdict = judge(&gpu, &stage, &light, &limits, hidden);
                assert_eq!(verdict.missed, 0, "{}, {light:?}, {hidden}: {verdict:?}", scene.name);
                assert!(verdict.inside > 50, "{}, {light:?}: {verdict:?}", scene.name);
                sums[i][0] += verdict.without;
                sums[i][1] += verdict.volumes;
            }
        }
    }
    let [[open, all], [covered, _]] = sums;
    assert!(
        open * 10 > all && covered > open,
        "{open}, with hidden ones {covered} of {all} left away"
    );
}

/// The map of what another camera sees is no map of what this one sees.
#[test]
fn a_map_of_other_samples_misses() {
    let gpu = Gpu::new(&GpuOptions::default()).unwrap_or_else(|e| panic!("{e}"));
    let scene = generate::street();
    let camera = scene.camera_or_framing();
    let aside = DVec3::new(3.0, 0.0, 1.0);
    let other = Camera { eye: camera.eye + aside, target: camera.target + aside, ..camera };
    let [seen, aside] = [camera, other].map(|camera| stage(&gpu, &scene, camera));
    for kind in [LightKind::Directional, LightKind::Point] {
        let light = scene.light_or_placed(kind);
        let savings = Savings { litmap: 128, ..Savings::WINDOW };
        let limits = limits(&gpu, &aside, &light, savings, false);
        let verdict = judge(&gpu, &seen, &light, &limits, false);
        assert!(verdict.missed > 20, "{light:?}: {verdict:?}");
    }
}
