//! Contacts of soft shadows: what the triangles that texels name add to a coarse map.

use crate::shared::area;
use crate::shared::reticent::Reticent;

use antumbra::Config;
use antumbra_gpu::{Frame, Gpu};
use antumbra_map::Plain;
use antumbra_reference::{SampleClass, TruthOptions};
use antumbra_scene::{Light, generate};
use antumbra_soft::{BackProjection, Bitmask, Pattern, Pcss, Vssm, Window};
use antumbra_tests::gpu;
use area::{bodies, lights, map, mean, seen, shoot, shots};

/// Techniques that have an option for it, with it.
fn techniques(size: u32, reach: u32) -> [Config; 4] {
    let (map, window) = (map(size), Window { reach, ..Window::default() });
    [
        Config::Bitmask(Bitmask { map, window, ..Bitmask::default() }),
        Config::Pcss(Pcss { map, window, ..Pcss::default() }),
        Config::Vssm(Vssm { map, reach, ..Vssm::default() }),
        Config::BackProjection(BackProjection { map, window }),
    ]
}

/// The street, whose kerbs, sills and feet of walls are within a texel or two of what they shadow.
#[test]
fn named_triangles_sharpen_contacts_and_only_darken_other_estimates() {
    let gpu = gpu();
    let scene = generate::by_name("street").expect("a scene");
    let stage = seen(&gpu, &scene, 128);
    let sun = Light::sun(0.7, 0.6, 2f64.to_radians());
    let low = Light::sun(0.5, 2.4, 2f64.to_radians());
    for light in [sun, low] {
        let truth = stage.truth(&light, &TruthOptions::default());
        for (config, named) in techniques(512, 0).iter().zip(&techniques(512, 2)) {
            let plain = shoot(&gpu, &stage, &light, config);
            let sharp = shoot(&gpu, &stage, &light, named);
            let mut gains = Vec::new();
            for (((a, b), v), class) in
                plain.iter().zip(&sharp).zip(&truth.visibility).zip(&truth.class)
            {
                if *class == SampleClass::Counted {
                    gains.push(f64::from(a - v).powi(2) - f64::from(b - v).powi(2));
                }
                let may_rise = matches!(config, Config::Bitmask(_));
                assert!(b <= a || may_rise, "{named:?}: {b}, brighter than {a}");
            }
            // Sample by sample, whose mean is no accident of four standard errors.
            let (gain, by) = mean(&gains);
            assert!(gain > 4.0 * by, "{named:?}, {light:?}: errs less by {gain} +- {by}");
        }
    }
}

#[test]
fn lights_without_an_extent_give_the_plain_maps_bits_with_names_too() {
    let gpu = gpu();
    let stage = seen(&gpu, &bodies(), 64);
    let lights = lights(0.0);
    let pairs = || lights.iter().map(|light| (&stage, light));
    let plain = shots(&gpu, &Config::Plain(Plain { map: map(128) }), pairs());
    for config in techniques(128, 4) {
        for ((found, _), (plain, _)) in shots(&gpu, &config, pairs()).iter().zip(&plain) {
            assert_eq!(found, plain, "{config:?}");
        }
    }
}

#[test]
fn names_that_cannot_be_had_are_refused_with_a_fix() {
    let gpu = gpu();
    let refuses = |gpu: &Gpu, config: &Config, fix: &str| {
        let error = config.build(gpu).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(error.contains(fix), "{config:?}: `{error}` says nothing of `{fix}`");
    };
    for config in techniques(64, 5) {
        refuses(&gpu, &config, "use 0 to 4 texels");
    }
    let window = Window { reach: 1, ..Window::default() };
    let pattern = Pattern::Hammersley;
    let masks = Config::Bitmask(Bitmask { window, pattern, ..Bitmask::default() });
    refuses(&gpu, &masks, "leave `reach` at 0");

    let stage = seen(&gpu, &bodies(), 32);
    let light: Light = lights(0.5)[1];
    let reticent = Reticent(&stage.meshes);
    let frame = Frame { casters: &reticent, ..stage.frame(&light) };
    for (config, reach) in
        [0, 1].into_iter().flat_map(|reach| techniques(64, reach).map(|config| (config, reach)))
    {
        let mut technique = config.build(&gpu).expect("a valid config");
        let error = technique.prepare(&gpu, &frame).err().map(|e| e.to_string());
        assert_eq!(error.is_some(), reach > 0, "{config:?}: {error:?}");
        assert!(
            error.as_ref().is_none_or(|e| e.contains("implement `Casters::triangles`")),
            "{error:?}"
        );
    }
}
