//! Pages that are kept from frame to frame.

use std::collections::BTreeSet;

use antumbra::Config;
use antumbra_measure::Stage;
use antumbra_sampling::ResolutionMatched;
use antumbra_sampling::matched::Page;
use antumbra_scene::{Camera, Light, LightKind, generate};
use antumbra_tests::gpu;
use glam::DVec3;

use super::{built, occupied, of_size, requests, shoot, stage, yard};

#[test]
fn a_still_frame_draws_nothing_and_a_moving_caster_only_what_it_touches() {
    let gpu = gpu();
    let light = Light::sun(1.0, 0.4, 0.0);
    let config = ResolutionMatched { page: 16, displacement: 0.5, ..of_size(1024) };
    let mut technique = built(&gpu, &config);
    let (first, second) = (stage(&gpu, &yard(0.0), 128), stage(&gpu, &yard(0.3), 128));
    let fresh = shoot(&gpu, &first, &light, &mut technique);
    let counters = &fresh.counters;
    let used = counters["pages_in_use"];
    assert!(used > 20, "{used} pages");
    assert_eq!((counters["pages_rendered"], counters["pages_reused"]), (used, 0), "at first");
    let occupied = counters["pages_requested"] - counters["pages_empty"];
    assert_eq!(occupied, used, "no page that no sample asks for or nothing lies on");

    let still = shoot(&gpu, &first, &light, &mut technique);
    assert_eq!(still.counters["pages_rendered"], 0, "a still frame");
    assert_eq!(
        (still.counters["pages_reused"], still.counters["page_triangles"]),
        (used, 0),
        "still"
    );
    assert_eq!(still.visibility, fresh.visibility, "the same picture");

    let moved = shoot(&gpu, &second, &light, &mut technique);
    let drawn = moved.counters["pages_rendered"];
    assert!(drawn > 0 && 2 * drawn < moved.counters["pages_in_use"], "{drawn} pages are touched");
    let alone = shoot(&gpu, &second, &light, &mut built(&gpu, &config));
    assert_eq!(moved.visibility, alone.visibility, "as if nothing had been kept");
    assert_ne!(moved.visibility, fresh.visibility, "the shadow moves");

    let turned = shoot(&gpu, &second, &Light::sun(1.0, 0.5, 0.0), &mut technique);
    let drawn = turned.counters["pages_rendered"];
    assert_eq!(drawn, turned.counters["pages_in_use"], "under another light all is drawn");
    assert_eq!(turned.counters["pages_reused"], 0, "and nothing kept");
    // And back: pages of a window that is no longer kept are not taken for its own.
    let back = shoot(&gpu, &first, &light, &mut technique);
    assert_eq!(back.visibility, fresh.visibility, "back");
}

#[test]
fn what_is_made_of_kept_pages_is_kept() {
    let gpu = gpu();
    let mut of = Config::Evsm(Default::default());
    of.set_map_size(1024);
    let config = ResolutionMatched { of, page: 64, table: 16, displacement: 0.5 };
    let light = Light::sun(1.0, 0.4, 0.0);
    let mut technique = built(&gpu, &config);
    let (first, second) = (stage(&gpu, &yard(0.0), 64), stage(&gpu, &yard(0.3), 64));
    let fresh = shoot(&gpu, &first, &light, &mut technique);
    let texels = fresh.counters["store_texels"];
    assert!(texels >= 2 * 1024 * 1024, "{texels} texels of two passes over the atlas");
    let still = shoot(&gpu, &first, &light, &mut technique);
    let counts = (still.counters["pages_rendered"], still.counters["store_texels"]);
    assert_eq!(counts, (0, 0), "a still frame");
    assert_eq!(still.counters["store_taps"], 0, "a still frame");
    assert_eq!(still.visibility, fresh.visibility, "the same picture");
    // What changes is made, then as when nothing had been kept.
    let turned = Light::sun(1.0, 0.5, 0.0);
    for (what, stage, light) in
        [("a caster", &second, &light), ("the light", &second, &turned), ("back", &first, &turned)]
    {
        let moved = shoot(&gpu, stage, light, &mut technique);
        assert_eq!(moved.counters["store_texels"], texels, "{what} moves");
        let alone = shoot(&gpu, stage, light, &mut built(&gpu, &config));
        // A page may have another slot, and places in the atlas, of 1024 texels, other roundings: of 2^-15 texels, in which
        // visibility changes by less than it would at an edge a thirtieth of a texel wide.
        let pairs = moved.visibility.iter().zip(&alone.visibility);
        let off = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(off <= 1e-3, "{what} moves: {off} from the picture");
        assert_ne!(moved.visibility, fresh.visibility, "{what} moves: another picture");
        let still = shoot(&gpu, stage, light, &mut technique);
        assert_eq!(still.counters["store_texels"], 0, "{what} stands still");
        assert!(still.visibility == moved.visibility, "{what} stands still: the picture");
    }
}

#[test]
fn a_camera_that_moves_has_only_those_pages_drawn_that_nobody_asked_for_before() {
    let gpu = gpu();
    let scene = generate::by_name("street").expect("a scene");
    let camera = scene.camera_or_framing();
    let config = ResolutionMatched { page: 16, displacement: 0.5, ..of_size(1024) };
    for kind in [LightKind::Directional, LightKind::Spot] {
        let light = scene.light_or_placed(kind);
        let mut technique = built(&gpu, &config);
        let mut before = BTreeSet::new();
        let (mut drawn, mut reused) = (0, 0);
        for step in 0..6 {
            // Forwards by 20 cm a frame, and to the side.
            let by = (camera.target - camera.eye).normalize() * (0.2 * f64::from(step))
                + DVec3::new(0.1, 0.0, 0.05) * f64::from(step);
            let moved = Camera { eye: camera.eye + by, target: camera.target + by, ..camera };
            let stage = Stage::new(&gpu, &scene, moved, 96, 96).expect("a stage");
            let shot = shoot(&gpu, &stage, &light, &mut technique);
            let counters = &shot.counters;
            assert_eq!(counters["pages_clamped"], 0, "{kind:?}: an atlas that suffices");
            let requests = requests(&gpu, technique.as_ref());
            let pages: BTreeSet<Page> = occupied(&requests).into_keys().collect();
            // No more than the atlas holds are seen in all, so that none has left it.
            let new = pages.difference(&before).count() as u64;
            assert_eq!(counters["pages_rendered"], new, "{kind:?}, step {step}: new pages");
            assert_eq!(
                counters["pages_reused"],
                pages.len() as u64 - new,
                "{kind:?}, step {step}: the others"
            );
            let fresh = shoot(&gpu, &stage, &light, &mut built(&gpu, &config));
            assert_eq!(shot.visibility, fresh.visibility, "{kind:?}, step {step}: the picture");
            before.extend(pages);
            assert!(before.len() <= 4096, "{kind:?}: {} pages", before.len());
            if step > 0 {
                drawn += new;
                reused += counters["pages_reused"];
            }
        }
        assert!(drawn > 0, "{kind:?}: something comes into view");
        assert!(reused > 2 * drawn, "{kind:?}: {drawn} pages are drawn and {reused} kept");
    }
}
