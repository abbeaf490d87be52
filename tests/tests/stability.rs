//! The hard cases: every technique behaves as its table of verdicts says, and the table can be wrong.

use antumbra::{Config, catalogue};
use antumbra_filter::{Esm, Fallback, PcfBilinearGrid, PcfCastano, PcfGrid, PcfPoisson};
use antumbra_gpu::{
    Counters, Expectation, Frame, Gpu, GpuError, Recorder, Technique, TechniqueConfig as _,
};
use antumbra_map::{Bias, DiscShadows, MapConfig, MapTechnique, Plain, SecondDepth, SecondSurface};
use antumbra_measure::stability::{CASES, Case, Kind};
use antumbra_scene::Light;
use antumbra_soft::{Bitmask, Window};
use antumbra_tests::{gpu, one_in};
use glam::DVec3;

/// The catalogue and the widest kernels that people use.
fn techniques(size: u32) -> Vec<Config> {
    let named = Window { reach: 2, ..Window::default() };
    let mut all = catalogue();
    all.extend([
        Config::PcfGrid(PcfGrid { side: 7, ..Default::default() }),
        Config::PcfBilinearGrid(PcfBilinearGrid { side: 6, ..Default::default() }),
        Config::PcfCastano(PcfCastano { side: 7, ..Default::default() }),
        Config::PcfCastano(PcfCastano { side: 7, hardware: true, ..Default::default() }),
        Config::PcfPoisson(PcfPoisson { radius: 3.5, ..Default::default() }),
        Config::SecondDepth(SecondDepth {
            surface: SecondSurface::SecondLayer,
            ..Default::default()
        }),
        Config::SecondDepth(SecondDepth { bias: 0.1, ..Default::default() }),
        Config::Esm(Esm { fallback: Fallback::Deeper, ..Default::default() }),
        Config::Plain(Plain { map: MapConfig { receiver_mask: true, ..Default::default() } }),
        Config::Bitmask(Bitmask { window: named, ..Default::default() }),
    ]);
    for config in &mut all {
        config.set_map_size(size);
    }
    all
}

fn measure(gpu: &Gpu, case: &Case, config: &Config, size: u32) -> f64 {
    let mut technique = config.build(gpu).expect("a valid config");
    let measured = case.measure(gpu, technique.as_mut(), size);
    measured.unwrap_or_else(|e| panic!("{}, {config:?}: {e}", case.name))
}

/// Checks the techniques that `which` keeps on the cases of a kind that `keep` keeps: one in `of` of them, each technique on
/// others, so that no case and no technique is left out.
fn check(size: u32, of: usize, keep: fn(Kind) -> bool, which: fn(&Config) -> bool) {
    let gpu = gpu();
    let mut surprises = Vec::new();
    for (turn, config) in techniques(size).into_iter().filter(which).enumerate() {
        // One for all cases: none may leave anything behind for the next.
        let mut technique = config.build(&gpu).expect("a valid config");
        let cases = CASES.iter().filter(|case| keep(case.kind)).collect();
        for case in one_in(of, turn, cases) {
            let Some(expected) = config.expectation(case.name) else { continue };
            let measured = case.measure(&gpu, technique.as_mut(), size);
            let met = match (&measured, expected) {
                (Err(_), Expectation::Refuses { .. }) => true,
                (Ok(number), _) => expected.is_met_by(*number),
                (Err(_), _) => false,
            };
            if !met {
                surprises
                    .push(format!("{}, {config:?}: {measured:?}, not {expected:?}", case.name));
            }
        }
    }
    assert!(surprises.is_empty(), "not as expected:\n{}", surprises.join("\n"));
}

/// Shadows on planes have no samples of a light's map to place.
const WITHOUT_MAP: [&str; 3] = ["map/planar", "map/shadow-texture", "map/disc"];

/// Families of which something is said on every other case. Of the others, `cargo xtask bench --suite stability` shows
/// what is measured.
const JUDGED: &[&str] = &["map/", "filter/", "sampling/", "soft/"];

/// Filters that bound nothing: of them something is said where casters are level.
const LEVEL_ONLY: [&str; 5] = [
    "filter/multiple-depth",
    "filter/power-function",
    "filter/blurred-depth",
    "filter/soft-comparison",
    "filter/convolution",
];

#[test]
fn something_is_said_of_these_techniques_on_every_case() {
    let silent = |config: &Config| -> Vec<&str> {
        let judged = |kind: Kind| match kind {
            Kind::HardShadow | Kind::SelfShadowing => true,
            Kind::Placement => !WITHOUT_MAP.contains(&config.id()),
            Kind::AreaLight => config.id().starts_with("soft/"),
            // `volume/translucent` alone looks for casters that let light through.
            Kind::Translucency => false,
        };
        let unsaid = CASES
            .iter()
            .filter(|case| judged(case.kind) && config.expectation(case.name).is_none());
        unsaid.map(|case| case.name).collect()
    };
    let all: Vec<String> = techniques(1024)
        .iter()
        .filter(|config| JUDGED.iter().any(|family| config.id().starts_with(family)))
        .filter(|config| !LEVEL_ONLY.contains(&config.id()))
        .map(|config| (config, silent(config)))
        .filter(|(_, cases)| !cases.is_empty())
        .map(|(config, cases)| format!("{config:?}: {cases:?}"))
        .collect();
    assert!(all.is_empty(), "nothing said of\n{}", all.join("\n"));
}

/// Filters that keep depth as it is and compare it anew for each lookup.
fn compares(config: &Config) -> bool {
    config.id().starts_with("filter/pcf") || config.id() == "filter/interleaved"
}

/// Checks on small maps what `which` keeps, each technique on every other case: `cargo xtask bench --suite stability` runs
/// all on all. In parts, so that no core waits for the last of all.
fn check_small(which: fn(&Config) -> bool) {
    check(128, 2, |kind| kind != Kind::Placement, which);
}

#[test]
fn maps_are_as_expected_on_small_maps() {
    check_small(|config| config.id().starts_with("map/"));
}

#[test]
fn comparing_filters_are_as_expected_on_small_maps() {
    check_small(compares);
}

#[test]
fn stores_are_as_expected_on_small_maps() {
    check_small(|config| config.id().starts_with("filter/") && !compares(config));
}

#[test]
fn soft_shadows_are_as_expected_on_small_maps() {
    check_small(|config| config.id().starts_with("soft/"));
}

#[test]
fn all_else_is_as_expected_on_small_maps() {
    check_small(|config| {
        !["map/", "filter/", "soft/"].iter().any(|family| config.id().starts_with(family))
    });
}

/// What is looked up in a map does not ask where its samples went: all others run on these cases in
/// `cargo xtask bench --suite stability`, and over each layout in `composition`.
#[test]
fn samples_are_placed_as_expected_on_small_maps() {
    let places =
        |config: &Config| config.id() == "map/plain" || config.id().starts_with("sampling/");
    check(128, 1, |kind| kind == Kind::Placement, places);
}

/// On maps of the usual size: what reads depth alone, by one texel and by 7 x 7. `cargo xtask bench --suite stability` runs all.
#[test]
fn depth_maps_are_as_expected_on_middling_maps() {
    check(
        1024,
        1,
        |kind| kind != Kind::Placement,
        |config| match config {
            Config::Plain(plain) => !plain.map.receiver_mask,
            Config::PcfGrid(grid) => grid.side == 7,
            _ => false,
        },
    );
}

#[test]
fn no_receiver_shadows_itself_on_large_maps() {
    // What compares each texel with the receiver. Filtered stores of this size take minutes and gigabytes here, and what is
    // made of such a map by others has its bias.
    let comparing = |config: &Config| config.id().starts_with("map/") || compares(config);
    check(2048, 1, |kind| kind == Kind::SelfShadowing, comparing);
}

fn case(name: &str) -> &'static Case {
    Case::by_name(name).unwrap_or_else(|| panic!("a case named {name}"))
}

#[test]
fn without_bias_half_of_a_sloped_plane_is_in_false_shadow_and_that_fails() {
    let map = MapConfig { size: 1024, bias: Bias::NONE, ..MapConfig::default() };
    let config = Config::Plain(Plain { map });
    let case = case("HC-03 grazing plane");
    let rate = measure(&gpu(), case, &config, 1024);
    // Each texel is split by its centre's depth: one half.
    assert!((rate - 0.5).abs() < 0.02, "false shadow on {rate} of the plane");
    let expected = config.expectation(case.name).expect("an expectation");
    assert!(!expected.is_met_by(rate), "{rate} passed as {expected:?}");
}

#[test]
fn a_bias_too_large_opens_a_gap_and_that_fails() {
    let bias = Bias { slope: 20.0, receiver_plane: false, ..Bias::default() };
    let config =
        Config::Plain(Plain { map: MapConfig { size: 512, bias, ..MapConfig::default() } });
    let case = case("HC-04 thin wall");
    // 20 half texels of the floor's slope (1 at 45 degrees) against a wall that rises by 2 a texel.
    let gap = measure(&gpu(), case, &config, 512);
    assert!(gap > 3.0, "{gap} texels");
    let expected = config.expectation(case.name).expect("an expectation");
    assert!(!expected.is_met_by(gap), "{gap} passed as {expected:?}");
}

/// A shadow map drawn for another light than the one that is.
struct Astray {
    map: MapTechnique,
    lead: fn(&Light) -> Light,
}

/// A little off.
fn aside(light: &Light) -> Light {
    let aside = DVec3::new(0.1, 0.0, 0.1);
    match *light {
        Light::Directional { direction, angular_diameter } => {
            let direction = (direction + aside).normalize();
            Light::Directional { direction, angular_diameter }
        }
        other => other.translated(aside),
    }
}

/// Below everything, so that nothing that looks up is lit.
fn below(_: &Light) -> Light {
    Light::Point { position: DVec3::NEG_Y * 100.0 }
}

impl Technique for Astray {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>) -> Result<(), GpuError> {
        self.map.prepare(gpu, &Frame { light: &(self.lead)(frame.light), ..*frame })
    }

    fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        recorder: &mut Recorder<'_>,
        visibility: &wgpu::TextureView,
    ) -> Result<(), GpuError> {
        let light = (self.lead)(frame.light);
        self.map.encode(gpu, &Frame { light: &light, ..*frame }, recorder, visibility)
    }

    fn counters(&self) -> Counters {
        self.map.counters()
    }

    fn bytes(&self) -> u64 {
        self.map.bytes()
    }
}

/// Asserts that `technique` does not pass the cases of those names as a plain map.
fn assert_fails(gpu: &Gpu, technique: &mut dyn Technique, map: MapConfig, names: &[&str]) {
    let config = Config::Plain(Plain { map });
    let cases = CASES.iter().filter(|c| names.iter().any(|name| c.name.starts_with(name)));
    let mut tried = 0;
    for case in cases {
        let measured = case.measure(gpu, technique, map.size).expect("measured");
        let expected = config.expectation(case.name).expect("an expectation");
        assert!(!expected.is_met_by(measured), "{}: {measured} passed as {expected:?}", case.name);
        tried += 1;
    }
    assert!(tried >= names.len(), "{tried} cases of {names:?}");
}

#[test]
fn shadows_in_the_wrong_place_fail() {
    let gpu = gpu();
    let map = MapConfig { size: 1024, ..MapConfig::default() };
    let plain = MapTechnique::plain(&gpu, &map).expect("a valid config");
    let mut technique = Astray { map: plain, lead: aside };
    assert_fails(
        &gpu,
        &mut technique,
        map,
        &["HC-01", "HC-02", "HC-23 light at the eye", "HC-25", "HC-40"],
    );
}

#[test]
fn shadows_that_are_missing_or_everywhere_fail() {
    let gpu = gpu();
    let map = MapConfig { size: 256, ..MapConfig::default() };
    let lit = DiscShadows { opacity: 0.0, ..DiscShadows::default() };
    let mut lit = lit.build(&gpu).expect("a valid config");
    assert_fails(&gpu, lit.as_mut(), map, &["HC-22", "HC-24 light in a cube"]);
    let plain = MapTechnique::plain(&gpu, &map).expect("a valid config");
    let mut dark = Astray { map: plain, lead: below };
    assert_fails(&gpu, &mut dark, map, &["HC-24 light at a vertex", "HC-24 light on the floor"]);
}

/// A shadow map under a sun that turns by a twentieth of a degree a frame.
struct Turning(MapTechnique, f64);

impl Turning {
    fn light(&self) -> Light {
        Light::sun(45_f64.to_radians(), 0.3 + self.1, 0.0)
    }
}

impl Technique for Turning {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>) -> Result<(), GpuError> {
        self.1 += 0.05_f64.to_radians();
        self.0.prepare(gpu, &Frame { light: &self.light(), ..*frame })
    }

    fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        recorder: &mut Recorder<'_>,
        visibility: &wgpu::TextureView,
    ) -> Result<(), GpuError> {
        let light = self.light();
        self.0.encode(gpu, &Frame { light: &light, ..*frame }, recorder, visibility)
    }

    fn counters(&self) -> Counters {
        self.0.counters()
    }

    fn bytes(&self) -> u64 {
        self.0.bytes()
    }
}

#[test]
fn shadows_that_move_under_a_creeping_camera_fail() {
    let (gpu, size) = (gpu(), 1024);
    let map = MapConfig { size, ..MapConfig::default() };
    let mut technique = Turning(MapTechnique::plain(&gpu, &map).expect("a valid config"), 0.0);
    let config = Config::Plain(Plain { map });
    let case = case("HC-39 creeping camera");
    let measured = case.measure(&gpu, &mut technique, size).expect("measured");
    let expected = config.expectation(case.name).expect("an expectation");
    assert!(!expected.is_met_by(measured), "{measured} passed as {expected:?}");
}

#[test]
fn to_cure_a_known_limit_is_as_unexpected_as_to_fall_short_of_it() {
    let limits = CASES.iter().flat_map(|case| {
        let all = techniques(1024).into_iter();
        all.filter_map(|config| config.expectation(case.name))
    });
    let mut count = 0;
    for limit in limits {
        if let Expectation::KnownLimit { at_least, at_most, .. } = limit {
            count += 1;
            assert!(!limit.is_met_by(0.0), "a success passed as {limit:?}");
            let worse = 1.01 * at_most;
            let finite = worse.is_finite();
            assert!(!finite || !limit.is_met_by(worse), "a worse failure passed as {limit:?}");
            assert!(at_least <= at_most, "no number can meet {limit:?}");
        }
    }
    assert!(count > 0, "the table has no known limit");
}
