//! Shadow maps in spans along their rows: the depth that was drawn, within the tolerance, and the plain map's answers.

use antumbra_gpu::{Counters, Frame, Gpu, Recorder, TechniqueConfig, read_f32_texture};
use antumbra_map::twin::scan_lines::{cut, depth_at};
use antumbra_map::{MapConfig, Omni, Plain, ScanLineStore, ScanLines, ShadowMap, Store};
use antumbra_measure::Stage;
use antumbra_scene::{Light, LightKind, generate};
use antumbra_tests::{gpu, submit};

const MAP: u32 = 512;

/// The map of `light` and its spans.
fn spans(gpu: &Gpu, frame: &Frame<'_>, config: &ScanLines) -> (ShadowMap, ScanLineStore) {
    let mut map = ShadowMap::new(gpu, MAP, 2, Box::new(Omni::Cube)).expect("a valid size");
    let mut store = ScanLineStore::new(gpu, config).expect("valid settings");
    map.prepare(gpu, frame).expect("prepared");
    store.prepare(gpu, frame, &map).expect("prepared");
    submit(gpu, |recorder: &mut Recorder<'_>| {
        map.encode(frame, recorder);
        store.encode(gpu, frame, &map, recorder).expect("encoded");
    });
    (map, store)
}

#[test]
fn every_texel_has_its_depth_within_the_tolerance_and_never_nearer() {
    let gpu = gpu();
    for (name, kind) in [
        ("sphere", LightKind::Directional),
        ("street", LightKind::Directional),
        ("street", LightKind::Spot),
        ("sphere", LightKind::Point),
    ] {
        let scene = generate::by_name(name).expect("a generated scene");
        let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 32, 32).expect("a stage");
        let light = scene.light_or_placed(kind);
        let config = ScanLines { room: MAP, ..ScanLines::default() };
        let (map, store) = spans(&gpu, &stage.frame(&light), &config);
        let (lines, all) = store.read(&gpu).expect("read back");
        let texture = map.texture().expect("a map with casters");
        let relative = !matches!(light, Light::Directional { .. });
        let (mut drawn, mut twins) = (0, 0);
        for layer in 0..map.layer_views().len() {
            let depth = read_f32_texture(&gpu, texture, layer as u32).expect("read back");
            for (t, row) in depth.chunks_exact(MAP as usize).enumerate() {
                let line = layer * MAP as usize + t;
                let found = &all[lines[line] as usize..lines[line + 1] as usize];
                for (s, z) in row.iter().enumerate() {
                    let off = f64::from(*z) - f64::from(depth_at(found, s as u32));
                    let share = if relative { f64::from(*z) } else { 1.0 };
                    let allowed = f64::from(config.tolerance) * share;
                    assert!(
                        off >= 0.0 && off <= allowed,
                        "{name}, {kind:?}, layer {layer}, {s}, {t}: {z} is off by {off}"
                    );
                    drawn += usize::from(*z > 0.0);
                }
                let (absolute, relative) =
                    if relative { (0.0, config.tolerance) } else { (config.tolerance, 0.0) };
                twins += cut(row, absolute, relative).len();
            }
        }
        assert!(drawn > 1000, "{name}, {kind:?}: {drawn} texels of casters");
        // A device may round a slope's bound to the other side: then a span ends elsewhere.
        let count = *lines.last().expect("a sum") as usize;
        assert!(count.abs_diff(twins) * 100 <= twins, "{name}, {kind:?}: {count}, twin {twins}");
    }
}

fn shoot(
    gpu: &Gpu,
    stage: &Stage,
    light: &Light,
    config: &dyn TechniqueConfig,
) -> (Vec<f32>, Counters) {
    let mut technique = config.build(gpu).expect("a valid config");
    let shot = stage.shoot(gpu, light, technique.as_mut(), 0).expect("a shot");
    (shot.visibility, shot.counters)
}

#[test]
fn the_answers_are_the_plain_maps_whatever_the_room() {
    let gpu = gpu();
    for name in ["sphere", "street", "tree"] {
        let scene = generate::by_name(name).expect("a generated scene");
        let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 128, 128).expect("a stage");
        for kind in [LightKind::Directional, LightKind::Spot, LightKind::Point] {
            let light = scene.light_or_placed(kind);
            let map = MapConfig { size: MAP, ..MapConfig::default() };
            let (plain, _) = shoot(&gpu, &stage, &light, &Plain { map });
            let differ = |tolerance, room| {
                let config = ScanLines { map, tolerance, room };
                let (found, work) = shoot(&gpu, &stage, &light, &config);
                let darker = found.iter().zip(&plain).filter(|(a, b)| a < b).count();
                assert_eq!(darker, 0, "{name}, {kind:?}: depth came nearer");
                (found.iter().zip(&plain).filter(|(a, b)| a > b).count(), work)
            };
            // Bit by bit, in spans and, where there is no room for any, in the map.
            for room in [MAP, 1] {
                assert_eq!(differ(0.0, room).0, 0, "{name}, {kind:?}, room for {room}");
            }
            // Within the tolerance: samples so near to what hides them are few, next to contacts.
            let (lit, work) = differ(ScanLines::default().tolerance, MAP);
            assert!(lit <= plain.len() / 2000, "{name}, {kind:?}: {lit} samples differ");
            let depth_bytes = work["map_texels"] * 4;
            assert!(work["span_bytes"] < depth_bytes, "{name}, {kind:?}: {work:?}");
            // The control: what is hidden by less than a hundredth of the range comes to light.
            if name == "street" && kind == LightKind::Directional {
                let (lit, _) = differ(0.01, MAP);
                assert!(lit > plain.len() / 500, "a coarse tolerance lights only {lit} samples");
            }
        }
    }
}

#[test]
fn a_scene_of_planes_takes_a_twentieth_of_its_map() {
    let gpu = gpu();
    let scene = generate::by_name("thin-wall").expect("a generated scene");
    let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 64, 64).expect("a stage");
    let light = scene.light_or_placed(LightKind::Directional);
    let map = MapConfig { size: MAP, ..MapConfig::default() };
    let (_, work) = shoot(&gpu, &stage, &light, &ScanLines { map, ..ScanLines::default() });
    let depth = work["map_texels"] * 4;
    assert!(20 * work["span_bytes"] <= depth, "{} bytes of {depth}", work["span_bytes"]);
}

#[test]
fn settings_out_of_range_are_refused() {
    let gpu = gpu();
    for (tolerance, room) in [(-1e-6, 64), (0.02, 64), (f32::NAN, 64), (1e-5, 0), (1e-5, 20000)] {
        let config = ScanLines { tolerance, room, ..ScanLines::default() };
        assert!(config.build(&gpu).is_err(), "{config:?}");
    }
}
