//! Kernels over pages see what they see in one map, across the pages' borders too.

use std::any::Any;
use std::collections::BTreeSet;

use antumbra::Config;
use antumbra_filter::PcfBilinearGrid;
use antumbra_gpu::{Frame, Gpu, GpuError};
use antumbra_map::{Arrange, Estimator, Fitting, Layout, MapConfig, MapTechnique, SeenView, Sight};
use antumbra_measure::Stage;
use antumbra_sampling::ResolutionMatched;
use antumbra_sampling::matched::{Limits, Standing, pages_of, windows};
use antumbra_scene::{Light, LightKind, generate};
use antumbra_tests::gpu;
use glam::{DVec2, DVec3};

use super::{built, layout, of_size, shoot, stage, window};

/// One map over the window of pages whose finest level has so many texels a side.
#[derive(Debug)]
struct SameWindow(u32);

impl Arrange for SameWindow {
    fn layout(&self, light: &Light) -> Layout {
        Layout::of(light)
    }

    fn fit(
        &self,
        frame: &Frame<'_>,
        hull: &[DVec3],
        _: Option<&Sight<'_>>,
        fitting: &Fitting,
    ) -> Result<Vec<SeenView>, GpuError> {
        let (receivers, mut standing) = (fitting.receivers, Standing::default());
        Ok(windows(frame.light, hull, frame.origin, self.0, receivers, &mut standing))
    }
}

#[test]
fn pages_of_the_finest_level_are_the_plain_map_of_its_size() {
    let gpu = gpu();
    for name in ["street", "tree", "fence"] {
        let scene = generate::by_name(name).expect("a scene");
        let mut stage = stage(&gpu, &scene, 128);
        // All samples ask for the finest level.
        stage.set_camera(None);
        for kind in [LightKind::Directional, LightKind::Spot, LightKind::Point] {
            let light = scene.light_or_placed(kind);
            // 16 x 16 pages of 28 x 28 texels and their borders, of which the atlas holds 1024.
            let config = ResolutionMatched { page: 32, table: 16, ..of_size(1024) };
            let shot = shoot(&gpu, &stage, &light, &mut built(&gpu, &config));
            assert_eq!(shot.counters["pages_clamped"], 0, "{name}, {kind:?}: all fit");
            assert_eq!(layout(&config, 1024).texels(), 448, "of the finest level");
            let map = MapConfig { size: 448, ..MapConfig::default() };
            let mut plain =
                MapTechnique::arranged(&gpu, &map, Estimator::nearest(), Box::new(SameWindow(448)))
                    .expect("a valid config");
            let plain = stage.shoot(&gpu, &light, &mut plain, 0).expect("a shot").visibility;
            let differ = shot.visibility.iter().zip(&plain).filter(|(a, b)| a != b).count();
            // Vertices reach the rasteriser by other roundings, of some 2^-13 texels, which now and then is a step of
            // its grid, 1/256 texel; and of such a step one sample in a thousand near an edge takes notice.
            assert!(differ <= 4, "{name}, {kind:?}: {differ} of {} samples", plain.len());
        }
    }
}

/// Techniques with kernels, on maps of `size`.
fn filters(size: u32) -> Vec<(&'static str, Config)> {
    let grid = PcfBilinearGrid { side: 4, ..Default::default() };
    let mut all = vec![
        ("grid", Config::PcfBilinearGrid(grid)),
        ("castano", Config::PcfCastano(Default::default())),
        ("footprint", Config::PcfFootprint(Default::default())),
        ("evsm", Config::Evsm(Default::default())),
        ("msm", Config::Msm(Default::default())),
    ];
    for (_, config) in &mut all {
        config.set_map_size(size);
    }
    all
}

/// Visibility of a technique over one map of `size` texels a side in the window of pages of `finest`.
fn in_one_map(
    gpu: &Gpu,
    stage: &Stage,
    light: &Light,
    of: &Config,
    (size, finest): (u32, u32),
) -> Vec<f32> {
    let mut of = of.clone();
    of.set_map_size(size);
    let technique: Box<dyn Any> = of.build(gpu).expect("a valid config");
    let technique = technique.downcast::<MapTechnique>().expect("a map's technique");
    let window = Box::new(SameWindow(finest));
    let mut technique = technique.rearranged(|_| Ok(window)).expect("a window");
    stage.shoot(gpu, light, &mut technique, 0).expect("a shot").visibility
}

/// A place in the atlas is rounded to 2^-14 texels, and over a texel visibility changes by no more than 1, or by the few
/// that bounds make of it.
const SAME_PLACE: f32 = 1.0 / 2048.0;

#[test]
fn filters_over_pages_are_filters_over_one_map_of_the_same_texels() {
    let gpu = gpu();
    let scene = generate::by_name("street").expect("a scene");
    let mut stage = stage(&gpu, &scene, 128);
    stage.set_camera(None);
    for kind in [LightKind::Directional, LightKind::Point] {
        let light = scene.light_or_placed(kind);
        for (name, of) in filters(1024) {
            // Of six faces not all pages of large borders fit.
            if kind == LightKind::Point && name != "grid" {
                continue;
            }
            let config =
                ResolutionMatched { of: of.clone(), page: 64, table: 8, displacement: 0.5 };
            let mut technique = built(&gpu, &config);
            let shot = shoot(&gpu, &stage, &light, &mut technique);
            assert_eq!(shot.counters["pages_clamped"], 0, "{name}, {kind:?}: all fit");
            assert!(shot.counters["pages_in_use"] > 8, "{name}, {kind:?}: many borders");
            let texels =
                pages_of(technique.as_ref()).expect("pages").layout().expect("it").texels();
            let one = |size| in_one_map(&gpu, &stage, &light, &of, (size, size));
            let off = |a: &[f32], b: &[f32]| {
                a.iter().zip(b).filter(|(a, b)| (*a - *b).abs() > SAME_PLACE).count()
            };
            let differ = off(&shot.visibility, &one(texels));
            // What the rasteriser makes of other roundings, a sample in a thousand notices. Four moments make more of any
            // rounding where depth hardly varies: there it is the mean that counts.
            let count = shot.visibility.len();
            assert!(differ <= 16 || name == "msm", "{name}, {kind:?}: {differ} of {count} differ");
            let mean = |a: &[f32], b: &[f32]| {
                let sum: f32 = a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum();
                sum / a.len() as f32
            };
            let by = mean(&shot.visibility, &one(texels));
            assert!(by <= SAME_PLACE, "{name}, {kind:?}: by {by} on average");
            // The control: texels that are a seventh smaller.
            let other = off(&shot.visibility, &one(texels * 8 / 7));
            assert!(other > 100, "{name}, {kind:?}: other texels make {other} differ");
        }
    }
}

/// As seen by a camera, with pages of several levels: next to a page's border a sample is what it is in one map of its
/// level's texels, as it is elsewhere.
#[test]
fn kernels_across_borders_of_pages_see_what_they_see_in_one_map() {
    let gpu = gpu();
    let scene = generate::by_name("street").expect("a scene");
    let stage = stage(&gpu, &scene, 128);
    let light = scene.light_or_placed(LightKind::Directional);
    for (name, of) in filters(1024) {
        let config = ResolutionMatched { of: of.clone(), page: 64, table: 16, displacement: 4.0 };
        // How far samples are off on average, far from borders and where kernels reach across them.
        let off = |border| {
            let limits = Limits { border, ..Limits::default() };
            let mut technique = config.build_within(&gpu, limits).expect("a valid config");
            let shot = shoot(&gpu, &stage, &light, &mut technique);
            let pages = pages_of(technique.as_ref()).expect("pages");
            let map = *pages.layout().expect("casters");
            let of_map: &dyn Any = technique.as_ref();
            let of_map = of_map.downcast_ref::<MapTechnique>().expect("a map's technique");
            let reach = f64::from(of_map.map().guard());
            let lookups = pages.read_lookups(&gpu).expect("read back");
            let levels: BTreeSet<u32> = lookups.iter().flatten().map(|page| page.level).collect();
            assert!(levels.len() > 1, "{name}: levels {levels:?}");
            let clip = window(&stage, &light, &map);
            let mut means = [(0.0, 0); 2];
            for level in levels {
                let sizes = (map.texels() >> level, map.texels());
                let one = in_one_map(&gpu, &stage, &light, &of, sizes);
                for (i, sample) in stage.view_samples().iter().enumerate() {
                    let Some(page) = lookups[i].filter(|page| page.level == level) else {
                        continue;
                    };
                    let ndc = clip.project_point3(sample.position.as_dvec3());
                    let st = DVec2::new(0.5 + 0.5 * ndc.x, 0.5 - 0.5 * ndc.y);
                    let tile = DVec2::from(page.tile.map(f64::from));
                    let inside =
                        (st * f64::from(map.table >> level) - tile) * f64::from(map.side());
                    let edge = inside.min(f64::from(map.side()) - inside).min_element();
                    let (sum, count) = &mut means[usize::from(edge < reach)];
                    *sum += f64::from((shot.visibility[i] - one[i]).abs());
                    *count += 1;
                }
            }
            means.map(|(sum, count)| {
                assert!(count > 500, "{name}: {count} samples");
                sum / f64::from(count)
            })
        };
        let same = f64::from(SAME_PLACE);
        let [elsewhere, across] = off(u32::MAX);
        assert!(elsewhere.max(across) <= same, "{name}: off by {elsewhere}, {across} at borders");
        // The control: pages without borders.
        let [elsewhere, across] = off(0);
        assert!(elsewhere <= same && across > 5.0 * same, "{name}: {elsewhere}, {across}");
    }
}
