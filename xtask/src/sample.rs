//! Made-up results for the tests of tables, page and comparison.

use std::collections::BTreeMap;
use std::path::Path;

use antumbra_reference::Metrics;
use antumbra_scene::Light;
use glam::DVec3;
use serde_json::json;

use crate::exr::FloatImage;
use crate::results::{
    Adapter, Expected, Files, Reference, Results, Run, SCHEMA, ScalingCurve, ScalingPoint,
    Settings, Spread, StabilityCase, Status, Time,
};

/// Name, mean absolute error, GPU milliseconds. The first is the plain map, the second takes 1.5
/// times as long.
const TECHNIQUES: [(&str, f64, f64); 9] = [
    ("map/plain", 0.0124, 1.0),
    ("filter/pcf-2x2", 0.0101, 1.5),
    ("filter/pcf-grid", 0.0082, 2.3),
    ("filter/pcf-regular", 0.0086, 4.9),
    ("filter/pcf-castano", 0.0071, 2.9),
    ("filter/pcf-poisson", 0.0093, 3.8),
    ("filter/evsm", 0.0071, 3.1),
    ("volume/z-fail", 0.0, 9.4),
    ("soft/pcss", 0.0035, 8.2),
];

const VIEW: (usize, usize) = (320, 180);

/// Two scenes, nine techniques, a stability matrix and scaling curves.
pub(crate) fn results() -> Results {
    let spot = Light::Spot {
        position: DVec3::new(1.0, 6.0, 2.5),
        direction: DVec3::new(-0.1, -1.0, -0.3).normalize(),
        outer_angle: 0.6,
    };
    let sun = Light::Directional {
        direction: DVec3::new(-0.3, -1.0, -0.2).normalize(),
        angular_diameter: 0.0093,
    };
    let mut runs = Vec::new();
    for (scene, light, scale) in [("half-plane", spot, 1.0), ("street of boxes", sun, 3.1)] {
        for (technique, mean_abs, gpu_ms) in TECHNIQUES {
            runs.push(run(scene, light, technique, mean_abs * scale, gpu_ms * scale, scale));
        }
    }
    skip(&mut runs[8], Status::Skipped("needs a light with an extent".to_owned()));
    skip(&mut runs[16], Status::Failed("the device was lost while drawing the volumes".to_owned()));
    Results {
        schema: SCHEMA,
        adapter: Adapter {
            name: "llvmpipe (LLVM 15.0.6, 256 bits)".to_owned(),
            backend: "vulkan".to_owned(),
            device_type: "Cpu".to_owned(),
            driver: "llvmpipe".to_owned(),
            driver_info: "Mesa 22.3.6 (LLVM 15.0.6)".to_owned(),
        },
        settings: Settings {
            suite: "quick".to_owned(),
            size: [VIEW.0 as u32, VIEW.1 as u32],
            map_size: 1024,
            light_samples: 256,
            repeat: 9,
            ground: false,
        },
        runs,
        stability: stability(),
        scaling: scaling(spot),
    }
}

fn skip(run: &mut Run, status: Status) {
    run.status = status;
    run.error = None;
    run.time = None;
    run.bytes = None;
    run.work.clear();
}

fn run(scene: &str, light: Light, technique: &str, mean_abs: f64, gpu_ms: f64, scale: f64) -> Run {
    Run {
        scene: scene.to_owned(),
        light,
        technique: technique.to_owned(),
        config: json!({ "map_size": 1024, "kernel": 3, "bias": { "constant": 0.1 } }),
        status: Status::Ok,
        error: Some(Metrics {
            view_samples: 51_234,
            excluded_facing: 4_321,
            outside_light: 77,
            ties: 12,
            mean_signed: mean_abs * 0.22,
            mean_abs,
            rmse: mean_abs * 6.3,
            leak: mean_abs * 0.61,
            over_shadow: mean_abs * 0.39,
            p95: mean_abs * 2.0,
            p99: mean_abs * 18.0,
            max: mean_abs * 25.0,
            bad_fraction: mean_abs * 1.3,
            penumbra_rmse: Some(mean_abs * 14.0),
            acne_rate: Some(mean_abs * 1e-5),
            flip: Some(mean_abs * 2.1),
        }),
        time: Some(Time {
            gpu_ms: Some(Spread { median: gpu_ms, min: 0.9 * gpu_ms, max: 1.2 * gpu_ms }),
            cpu_ms: Some(0.03),
            ratio_to_plain: Some(gpu_ms / scale),
        }),
        work: [("fetches".to_owned(), 51_234 * 9), ("texels_rendered".to_owned(), 1 << 20)].into(),
        bytes: Some(4 << 20),
        reference: Some(Reference {
            kind: "ray-traced".to_owned(),
            light_samples: 256,
            error_estimate: Some(8.4e-4),
        }),
        files: Files::default(),
    }
}

fn stability() -> Vec<StabilityCase> {
    let mut cases = Vec::new();
    for case in
        ["grazing receiver", "eye inside a shadow", "wire of 0.3 texels", "light behind the viewer"]
    {
        for technique in ["map/plain", "filter/pcf-grid", "volume/z-fail"] {
            let holds = case != "wire of 0.3 texels" || technique == "volume/z-fail";
            let pass = case != "eye inside a shadow" || technique != "volume/z-fail";
            cases.push(StabilityCase {
                case: case.to_owned(),
                about: "what a sample stands for".to_owned(),
                number: "share of wrong samples".to_owned(),
                technique: technique.to_owned(),
                expected: if holds { Expected::Holds } else { Expected::KnownLimit },
                reason: if holds {
                    String::new()
                } else {
                    "a caster thinner than a texel is drawn into the map only where it meets a texel's centre".to_owned()
                },
                at_least: if holds { None } else { Some(0.4) },
                bound: Some(if holds { 0.01 } else { 0.6 }),
                measured: Some(if !pass { 0.82 } else if holds { 0.004 } else { 0.5 }),
                pass: Some(pass),
            });
        }
    }
    cases
}

fn scaling(light: Light) -> Vec<ScalingCurve> {
    let curve = |technique: &str, factor: f64| ScalingCurve {
        scene: "half-plane".to_owned(),
        light,
        technique: technique.to_owned(),
        parameter: "map_size".to_owned(),
        points: [256.0, 512.0, 1024.0, 2048.0, 4096.0]
            .map(|value| ScalingPoint {
                value,
                mean_abs: Some(12.0 * factor / value),
                rmse: Some((3.0 * factor / value).sqrt()),
                gpu_ms: Some(0.4 + value * value * 2e-7 / factor),
                bytes: Some((value * value) as u64 * 4),
                work: BTreeMap::new(),
            })
            .to_vec(),
    };
    vec![curve("map/plain", 1.0), curve("filter/pcf-grid", 0.7), curve("filter/pcf-castano", 0.55)]
}

/// [`results`], with raw images of a disc's shadow for every run that is ok, written into `dir`.
pub(crate) fn with_pictures(dir: &Path) -> anyhow::Result<Results> {
    let mut results = results();
    let image = |f: &dyn Fn(f32, f32) -> f32| {
        let (width, height) = VIEW;
        let at =
            |i: usize| ((i % width) as f32 / height as f32, (i / width) as f32 / height as f32);
        FloatImage::new(width, height, (0..width * height).map(|i| [f(at(i).0, at(i).1)]).collect())
    };
    let penumbra = |x: f32, y: f32, soft: f32| {
        let distance = (x - 0.9).hypot((y - 0.6) * 1.6) - 0.35;
        (0.5 + distance / soft).clamp(0.0, 1.0)
    };
    image(&|x, y| penumbra(x, y, 0.08))?.write(&dir.join("reference.exr"))?;
    let position: Vec<[f32; 4]> = (0..VIEW.0 * VIEW.1)
        .map(|i| [0.0, 0.0, 0.0, if i / VIEW.0 > 36 { 1.0 } else { 0.0 }])
        .collect();
    FloatImage::new(VIEW.0, VIEW.1, position)?.write(&dir.join("position.exr"))?;
    for (i, run) in results.runs.iter_mut().enumerate().filter(|(_, r)| r.status == Status::Ok) {
        let cells = 20.0 + 10.0 * (i % 9) as f32;
        let snap = |v: f32| ((v * cells).floor() + 0.5) / cells;
        let name = format!("{i}-visibility.exr");
        image(&|x, y| penumbra(snap(x), snap(y), 0.02 * (1 + i % 5) as f32))?
            .write(&dir.join(&name))?;
        run.files = Files {
            visibility: Some(name),
            reference: Some("reference.exr".to_owned()),
            position: Some("position.exr".to_owned()),
            ..Files::default()
        };
    }
    Ok(results)
}
