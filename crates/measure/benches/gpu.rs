//! GPU time of the plain shadow map and of percentage-closer filtering, by timestamps where the device has
//! them, else by the wall clock around a submission.

use std::time::Duration;

use antumbra_filter::PcfGrid;
use antumbra_gpu::{Gpu, GpuOptions, Technique, TechniqueConfig as _};
use antumbra_map::{MapConfig, MapTechnique};
use antumbra_measure::{Shot, Stage};
use antumbra_scene::{LightKind, generate};
use criterion::{Criterion, criterion_group, criterion_main};

fn frames(c: &mut Criterion) {
    let gpu = Gpu::new(&GpuOptions::default()).expect("a GPU adapter");
    let scene = generate::by_name("street").expect("a generated scene");
    let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 256, 256).expect("a stage");
    let light = scene.light_or_placed(LightKind::Directional);
    let map = MapConfig { size: 1024, ..MapConfig::default() };
    let grid = PcfGrid { map, side: 7 };
    let techniques: [(&str, Box<dyn Technique>); 2] = [
        ("map/plain", Box::new(MapTechnique::plain(&gpu, &map).expect("a valid config"))),
        ("filter/pcf-grid-7", grid.build(&gpu).expect("a valid config")),
    ];
    let mut group = c.benchmark_group("gpu");
    group.sample_size(20);
    for (name, mut technique) in techniques {
        let mut session = stage.session(&gpu).expect("a session");
        group.bench_function(name, |b| {
            b.iter_custom(|iterations| {
                let mut shot = Shot::default();
                for _ in 0..iterations {
                    session
                        .repeat(&gpu, &light, technique.as_mut(), &mut shot, true)
                        .expect("a frame");
                }
                Duration::from_secs_f64(shot.gpu_ms.iter().sum::<f64>() * 1e-3)
            });
        });
    }
    group.finish();
}

criterion_group!(benches, frames);
criterion_main!(benches);
