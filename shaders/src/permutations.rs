//! Every shader that the project ships, for validation and export.

use crate::{LinkError, Slot, link, module, source};

/// A root module with its slots bound.
#[derive(Clone, Debug)]
pub struct Permutation {
    /// Name, unique, fit for a file name.
    pub name: String,
    /// The root module's path.
    pub root: &'static str,
    /// Its slots.
    pub slots: Vec<Slot>,
}

impl Permutation {
    /// Links the permutation to WGSL.
    ///
    /// # Errors
    /// As [`link`].
    pub fn link(&self) -> Result<String, LinkError> {
        link(self.root, &self.slots)
    }
}

/// The layouts of the shadow-map core: name and slots.
fn layouts() -> Vec<(&'static str, Vec<Slot>)> {
    let matrices = |path| vec![module("layout", path)];
    let charts = |path, chart| {
        vec![
            module("layout", path),
            module("common::projection", "map::curved"),
            module("chart", chart),
        ]
    };
    vec![
        ("single", matrices("map::layout_single")),
        ("cube", matrices("map::layout_cube")),
        ("tetrahedron", matrices("map::layout_tetrahedron")),
        ("isocube", charts("map::layout_isocube", "map::isocube")),
        ("paraboloid", charts("map::layout_paraboloid", "map::paraboloid")),
    ]
}

/// All permutations: every layout with every estimator, and the support passes.
///
/// Kernel sizes stand for all sizes: they are loop bounds.
#[must_use]
pub fn permutations() -> Vec<Permutation> {
    const PASSES: [&str; 16] = [
        "gpu::light_depth",
        "gpu::view_samples",
        "gpu::unproject",
        "gpu::probe",
        "map::planar",
        "map::shadow_texture",
        "map::mask_blur",
        "map::disc",
        "gpu::scan",
        "volume::triangle_faces",
        "volume::count",
        "volume::eye",
        "volume::resolve",
        "volume::triangle",
        "volume::receivers",
        "volume::silhouettes",
    ];
    let mut all: Vec<Permutation> =
        PASSES.map(|root| Permutation { name: file_name(root), root, slots: Vec::new() }).into();
    for (name, root, chart) in [
        ("map-traced-isocube", "map::traced", "map::isocube"),
        ("map-traced-paraboloid", "map::traced", "map::paraboloid"),
        ("map-warped-paraboloid", "map::warped", "map::paraboloid"),
    ] {
        all.push(Permutation { name: name.to_owned(), root, slots: vec![module("chart", chart)] });
    }
    for (layout, slots) in layouts() {
        all.push(Permutation {
            name: format!("map-sampling-error-{layout}"),
            root: "map::sampling_error",
            slots,
        });
    }
    for (estimator, slots) in estimators() {
        for (layout, layout_slots) in layouts() {
            let mut slots = slots.clone();
            slots.extend(layout_slots);
            all.push(Permutation {
                name: format!("map-resolve-{layout}-{estimator}"),
                root: "map::resolve",
                slots,
            });
        }
    }
    all
}

fn estimators() -> Vec<(&'static str, Vec<Slot>)> {
    let side = |n: i32| source("config", format!("const SIDE: i32 = {n};"));
    let core = |values: &[i32]| source("config", castano_constants(values));
    let loaded = module("store", "common::depth_map");
    let compared = module("store", "common::compare_map");
    let separable = module("estimator", "filter::separable");
    let taps = module("estimator", "filter::hardware_castano");
    let kernel = |path| module("kernel", path);
    let mut all = vec![
        ("nearest", vec![loaded.clone(), module("estimator", "map::nearest")]),
        ("hardware", vec![compared.clone(), module("estimator", "filter::hardware")]),
        (
            "poisson",
            vec![
                loaded.clone(),
                module("estimator", "filter::poisson"),
                source("config", poisson_constants(&[[0.0, 0.0], [0.5, -0.5]], 2.0)),
            ],
        ),
    ];
    for (name, n) in [("box-2", 2), ("box-3", 3), ("box-7", 7)] {
        let slots = vec![loaded.clone(), separable.clone(), kernel("filter::kernel::box"), side(n)];
        all.push((name, slots));
    }
    for (name, n) in [("tent-1", 1), ("tent-3", 3)] {
        let slots =
            vec![loaded.clone(), separable.clone(), kernel("filter::kernel::tent"), side(n)];
        all.push((name, slots));
    }
    let castano = || kernel("filter::kernel::castano");
    for (name, taps_name, n) in [
        ("castano-3", "castano-taps-3", 3),
        ("castano-5", "castano-taps-5", 5),
        ("castano-7", "castano-taps-7", 7),
    ] {
        let values = castano_core(n).unwrap_or(&[]);
        all.push((name, vec![loaded.clone(), separable.clone(), castano(), core(values)]));
        all.push((taps_name, vec![compared.clone(), taps.clone(), castano(), core(values)]));
    }
    all
}

/// The integer kernel of `side` texels (3, 5 or 7) of Castano 2013.
#[must_use]
pub fn castano_core(side: u32) -> Option<&'static [i32]> {
    match side {
        3 => Some(&[1, 2, 1]),
        5 => Some(&[1, 3, 4, 3, 1]),
        7 => Some(&[1, 5, 12, 16, 12, 5, 1]),
        _ => None,
    }
}

/// Constants for `filter::kernel::castano`.
#[must_use]
pub fn castano_constants(core: &[i32]) -> String {
    let padded: Vec<String> =
        std::iter::once(&0).chain(core).chain([&0]).map(|v| format!("{v}.0")).collect();
    format!(
        "const SIDE: i32 = {};\nconst CORE = array<f32, {}>({});\nconst DIVISOR: f32 = {}.0;",
        core.len(),
        padded.len(),
        padded.join(", "),
        core.iter().sum::<i32>(),
    )
}

/// Constants for `filter::poisson`: points in the unit disc, radius in texels.
#[must_use]
pub fn poisson_constants(points: &[[f32; 2]], radius: f32) -> String {
    let list: Vec<String> = points.iter().map(|[x, y]| format!("vec2f({x:?}, {y:?})")).collect();
    format!(
        "const COUNT: i32 = {0};\nconst POINTS = array<vec2f, {0}>({1});\nconst RADIUS: f32 = {radius:?};",
        points.len(),
        list.join(", "),
    )
}

fn file_name(root: &str) -> String {
    root.replace("::", "-").replace('_', "-")
}
