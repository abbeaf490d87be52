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
    let cascades = |path| {
        vec![
            module("layout", path),
            module("map::shadow", "sampling::cascade_shadow"),
            module("map::looked_up", "sampling::cascade_looked_up"),
            source("cascades", "const CASCADES: i32 = 4;"),
        ]
    };
    let pages =
        |path| vec![module("layout", path), module("map::shadow", "sampling::matched_shadow")];
    vec![
        ("single", matrices("map::layout_single")),
        (
            "objects",
            vec![
                module("layout", "map::layout_single"),
                module("map::shadow", "map::shadow_least"),
                source("objects", "const COUNT: i32 = 8;"),
            ],
        ),
        ("cube", matrices("map::layout_cube")),
        ("tetrahedron", matrices("map::layout_tetrahedron")),
        ("isocube", charts("map::layout_isocube", "map::isocube")),
        ("paraboloid", charts("map::layout_paraboloid", "map::paraboloid")),
        ("pages", pages("map::layout_single")),
        ("pages-of-a-cube", pages("map::layout_cube")),
        ("cascades-by-map", cascades("sampling::cascade_by_map")),
        ("cascades-by-depth", cascades("sampling::cascade_by_depth")),
    ]
}

/// All permutations: every layout with every estimator, and the support passes.
///
/// Kernel sizes stand for all sizes: they are loop bounds.
#[must_use]
pub fn permutations() -> Vec<Permutation> {
    const PASSES: &[&str] = &[
        "gpu::light_depth",
        "gpu::light_depth_cut",
        "gpu::view_samples",
        "gpu::view_samples_cut",
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
        "volume::translucent",
        "volume::batches",
        "volume::doubtful",
        "volume::receivers",
        "volume::cull",
        "volume::clamp",
        "volume::litmap_make",
        "volume::litmap_ask",
        "volume::silhouettes",
        "map::cull_clusters",
        "map::peel",
        "soft::mean_of_parts",
        "map::scan_lines",
        "map::between",
        "map::draw_ids",
        "sampling::matched_pages",
        "sampling::matched_casters",
        "sampling::matched_draw",
        "sampling::view_samples_lists",
        "sampling::view_samples_casters",
        "sampling::view_samples_pieces",
        "sampling::sdsm",
    ];
    let pass = |root: &&'static str| Permutation { name: file_name(root), root, slots: Vec::new() };
    let mut all: Vec<Permutation> = PASSES.iter().map(pass).collect();
    for (name, root, chart) in [
        ("map-traced-isocube", "map::traced", "map::isocube"),
        ("map-traced-paraboloid", "map::traced", "map::paraboloid"),
        ("map-warped-paraboloid", "map::warped", "map::paraboloid"),
    ] {
        all.push(Permutation { name: name.to_owned(), root, slots: vec![module("chart", chart)] });
    }
    for (name, slots) in [
        (
            "plain",
            vec![("volume::limits", "volume::no_limits"), ("volume::tally", "volume::no_tally")],
        ),
        ("limits", vec![("volume::tally", "volume::no_tally")]),
        ("tally", vec![("volume::limits", "volume::no_limits")]),
    ] {
        all.push(Permutation {
            name: format!("volume-count-{name}"),
            root: "volume::count",
            slots: slots.into_iter().map(|(slot, path)| module(slot, path)).collect(),
        });
    }
    let block = "const BLOCK: i32 = 4;\nconst FLATNESS: f32 = 0.1;";
    all.push(Permutation {
        name: "filter-interleaved-mean".to_owned(),
        root: "filter::interleaved_mean",
        slots: vec![source("config", block)],
    });
    for (layout, slots) in layouts() {
        for root in ["map::sampling_error", "map::receiver_mask"] {
            let name = format!("{}-{layout}", file_name(root));
            all.push(Permutation { name, root, slots: slots.clone() });
        }
    }
    all.extend(blurs());
    for (name, mut slots) in soft() {
        slots.push(module("layout", "soft::layout_turned"));
        all.push(Permutation {
            name: format!("map-resolve-turned-{name}"),
            root: "map::resolve",
            slots,
        });
    }
    for layout in ["soft::layout_sides", "soft::layout_turned", "map::layout_single"] {
        for (name, mut slots) in occlusion_textures() {
            slots.push(module("layout", layout));
            all.push(Permutation {
                name: format!("map-resolve-occlusion-textures-{name}-{}", file_name(layout)),
                root: "map::resolve",
                slots,
            });
        }
    }
    all.extend(tables());
    all.extend(pyramids());
    all.extend(widths());
    for layout in ["map::layout_single", "map::layout_cube"] {
        all.push(Permutation {
            name: format!("sampling-matched-request-{}", file_name(layout)),
            root: "sampling::matched_request",
            slots: vec![module("layout", layout)],
        });
    }
    // Maps of single objects ask all of them, in the place of the lookup that area lights replace; and in pages there is
    // nothing beyond a kernel.
    let is_soft = |slots: &[Slot]| slots.iter().any(|(slot, _)| slot == "map::through");
    for (estimator, slots) in estimators() {
        for (layout, layout_slots) in layouts() {
            if is_soft(&slots) && (layout == "objects" || layout.starts_with("pages")) {
                continue;
            }
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

/// Passes that filter a store: what each technique encodes, averages and writes.
fn blurs() -> Vec<Permutation> {
    let depth = "filter::from_depth";
    let sum = "gpu::mean::arithmetic";
    [
        ("vsm", depth, "filter::encoding::variance", sum, "rg32float"),
        ("vsm-slope", "filter::from_depth_slope", "filter::encoding::variance", sum, "rg32float"),
        ("lvsm", depth, "filter::encoding::layered", sum, "rg32float"),
        ("esm", depth, "filter::encoding::depth", "gpu::mean::exponential", "r32float"),
        (
            "esm-fallback",
            depth,
            "filter::encoding::depth_twice",
            "gpu::mean::exponential_and_largest",
            "rg32float",
        ),
        ("vsm-of-samples", "filter::from_samples", "filter::encoding::variance", sum, "rg32float"),
        ("depth", depth, "filter::encoding::depth", sum, "r32float"),
        ("depth-range", depth, "filter::encoding::depth_twice", "gpu::mean::min_max", "rg32float"),
        ("waves", depth, "filter::encoding::waves", sum, "rgba8unorm"),
        ("evsm", depth, "filter::encoding::warped", sum, "rgba32float"),
        ("msm", depth, "filter::encoding::moments", sum, "rgba32float"),
        ("msm-16", "gpu::stored_texel", "filter::encoding::moments_16", sum, "rg32uint"),
    ]
    .map(|(name, texel, encoding, mean, format)| Permutation {
        name: format!("gpu-blur-{name}"),
        root: "gpu::blur",
        slots: vec![
            module("texel", texel),
            module("sampled", depth),
            module("encoding", encoding),
            module("mean", mean),
            source("target", blur_target(format)),
            source("blur_config", "const RADIUS: i32 = 2;"),
            source("axis_config", "const AXIS: vec2i = vec2i(1, 0);"),
            filtered_constants(false),
        ],
    })
    .into()
}

/// Passes that make summed-area tables: along rows of encoded texels, and along columns of what came of these.
fn tables() -> Vec<Permutation> {
    let covered = Permutation {
        name: "gpu-sat-covered".to_owned(),
        root: "gpu::sat",
        slots: vec![
            module("texel", "soft::covered"),
            module("numbers", "gpu::sat_fixed"),
            module("summand", "gpu::sat_encoded"),
            source("target", table_target("r32uint")),
            source("axis_config", "const AXIS: vec2i = vec2i(1, 0);"),
            source("sat_config", "const SCALE: f32 = 1.0;"),
        ],
    };
    let moments = [
        ("fixed-rows", "gpu::sat_encoded", "gpu::sat_fixed", "rg32uint"),
        ("fixed-columns", "gpu::sat_stored", "gpu::sat_fixed", "rg32uint"),
        ("float-rows", "gpu::sat_encoded", "gpu::sat_float", "rg32float"),
        ("float-columns", "gpu::sat_stored", "gpu::sat_float", "rg32float"),
    ]
    .map(|(name, summand, numbers, format)| Permutation {
        name: format!("gpu-sat-{name}"),
        root: "gpu::sat",
        slots: vec![
            module("texel", "filter::from_depth"),
            module("encoding", "filter::encoding::variance_fixed"),
            module("numbers", numbers),
            module("summand", summand),
            source("target", table_target(format)),
            source("axis_config", "const AXIS: vec2i = vec2i(1, 0);"),
            source("sat_config", "const SCALE: f32 = 8388607.0;"),
        ],
    });
    moments.into_iter().chain([covered]).collect()
}

/// Passes that make mipmaps and N-buffers.
fn pyramids() -> Vec<Permutation> {
    let roots = ["gpu::mip_base", "gpu::mip", "gpu::nbuffer"];
    let means = [("average", "gpu::mean::arithmetic"), ("min-max", "gpu::mean::min_max")];
    let of_a_mean = |(name, mean): (&'static str, &'static str)| {
        roots.map(|root| Permutation {
            name: format!("{}-{name}", file_name(root)),
            root,
            slots: vec![
                module("texel", "gpu::stored_texel"),
                module("mean", mean),
                source("target", blur_target("rg32float")),
            ],
        })
    };
    let of_a_map =
        [("one", "soft::one_texel"), ("four", "soft::four_texels")].map(|(name, texel)| {
            Permutation {
                name: format!("gpu-mip-base-depths-of-{name}"),
                root: "gpu::mip_base",
                slots: vec![module("texel", texel), source("target", blur_target("rg32float"))],
            }
        });
    means.into_iter().flat_map(of_a_mean).chain(of_a_map).collect()
}

/// What looks up a filtered store.
fn filtered(store: &'static str, estimator: &'static str, both: bool) -> Vec<Slot> {
    let mean = match estimator {
        "filter::esm" => "gpu::mean::exponential",
        "filter::esm_fallback" => "gpu::mean::exponential_and_largest",
        "filter::multiple_depth" => "gpu::mean::min_max",
        _ => "gpu::mean::arithmetic",
    };
    vec![
        module("store", store),
        module("mean", mean),
        module("estimator", estimator),
        filtered_constants(both),
    ]
}

/// Constants of every filtered technique; each uses a few.
fn filtered_constants(both: bool) -> Slot {
    let numbers = [
        ("REACH", 3.0),
        ("SQUARE", 2.0),
        ("ROUNDING", 1e-6),
        ("NEGATIVE_ROUNDING", 1e-6),
        ("CUT", 0.0),
        ("LEAST_VARIANCE", 1e-6),
        ("LAYERS", 4.0),
        ("OVERLAP", 0.0025),
        ("SHARPNESS", 80.0),
        ("POSITIVE", 40.0),
        ("NEGATIVE", 5.0),
        ("DEVIATION", 5e-5),
        ("MOMENT_BIAS", 6e-5),
        ("SECOND_TARGET", 0.628),
        ("FOURTH_TARGET", 0.628),
        ("ORDER", 16.0),
        ("SQUEEZE", 0.9),
        ("DAMPING", 1.0),
        ("OFFSET", 0.0),
        ("SCALE", 2.0),
        ("WIDTH", 0.1),
        ("MARGIN", 1e-4),
        ("HALF", 1.0),
        ("MOST", 8.0),
        ("BEFORE", 1.0),
        ("LARGEST", 16.0),
        ("LOOKUPS", 8.0),
    ];
    let mut text = String::new();
    for (name, value) in numbers {
        text += &format!("const {name}: f32 = {value:?};\n");
    }
    text += &format!(
        "const BOTH: bool = {both};\nconst ALL: bool = true;\nconst FOLLOW: bool = true;\n"
    );
    text += "const OWN: bool = true;\nconst ENDS: bool = true;\nconst AROUND: i32 = 9;\nconst SAMPLES: i32 = 2;\n";
    text += "const SLICES: i32 = 8;\nconst TEXELS: i32 = 2;\nconst WEIGHTS = array<f32, 3>(0.0, 1.0, 0.0);\n";
    source("config", text)
}

/// The format-specific part of `gpu::blur`, for its slot `target`: a storage texture of WGSL's format `name`,
/// which only the module that declares it can write.
#[must_use]
pub fn blur_target(name: &str) -> String {
    let value = if name == "rg32uint" {
        "vec4u(pack2x16unorm(value.xy), pack2x16unorm(value.zw), 0u, 1u)"
    } else {
        "value"
    };
    format!(
        "@group(0) @binding(1) var output: texture_storage_2d_array<{name}, write>;\n\
         fn put(at: vec2i, layer: i32, value: vec4f) {{\n\
         textureStore(output, at, layer, {value});\n}}"
    )
}

/// As [`blur_target`] for tables of sums, whose integers are written as they are.
#[must_use]
pub fn table_target(name: &str) -> String {
    let value = if name.ends_with("uint") { "vec4u" } else { "vec4f" };
    format!(
        "@group(0) @binding(1) var output: texture_storage_2d_array<{name}, write>;\n\
         fn put(at: vec2i, layer: i32, value: {value}) {{\n\
         textureStore(output, at, layer, value);\n}}"
    )
}

fn estimators() -> Vec<(&'static str, Vec<Slot>)> {
    let side = |n: i32| source("config", format!("const SIDE: i32 = {n};"));
    let core = |values: &[i32]| source("config", castano_constants(values));
    let loaded = module("store", "common::depth_map");
    let compared = module("store", "common::compare_map");
    let gathered = module("store", "common::gather_map");
    let separable = module("estimator", "filter::separable");
    let taps = module("estimator", "filter::hardware_castano");
    let kernel = |path| module("kernel", path);
    let mut all = vec![
        ("nearest", vec![loaded.clone(), module("estimator", "map::nearest")]),
        (
            "scan-lines",
            vec![
                loaded.clone(),
                module("common::depth_map", "map::scan_line_map"),
                module("estimator", "map::nearest"),
            ],
        ),
        ("hardware", vec![gathered, module("estimator", "filter::hardware")]),
        ("hardware-comparison", vec![compared.clone(), module("estimator", "filter::hardware")]),
        (
            "poisson",
            vec![
                loaded.clone(),
                module("estimator", "filter::poisson"),
                source("config", poisson_constants(&[[0.0, 0.0], [0.5, -0.5]], 2.0)),
            ],
        ),
    ];
    for (name, store, estimator, both) in [
        ("vsm", "filter::texels", "filter::vsm", false),
        ("lvsm", "filter::texels", "filter::lvsm", false),
        ("esm", "filter::texels", "filter::esm", false),
        ("evsm", "filter::texels", "filter::evsm", true),
        ("evsm-2", "filter::texels", "filter::evsm", false),
        ("msm", "filter::texels", "filter::msm", false),
        ("msm-16", "filter::texels_16", "filter::msm", false),
        ("power-function", "filter::texels", "filter::power_function", false),
        ("esm-fallback", "filter::texels", "filter::esm_fallback", false),
        ("convolution", "filter::texels", "filter::convolution", false),
        ("multiple-depth", "filter::texels", "filter::multiple_depth", false),
        ("blurred-depth", "filter::texels", "filter::blurred_depth", false),
        ("soft-comparison", "filter::texels", "filter::soft_comparison", false),
        ("savsm", "filter::table_fixed", "filter::savsm", false),
        ("savsm-float", "filter::table_float", "filter::savsm", false),
        ("pcf-footprint", "common::depth_map", "filter::pcf_footprint", false),
    ] {
        all.push((name, filtered(store, estimator, both)));
    }
    for (name, estimator) in [
        ("vsm-footprint", "filter::vsm"),
        ("esm-footprint", "filter::esm"),
        ("evsm-footprint", "filter::evsm"),
        ("msm-footprint", "filter::msm"),
    ] {
        all.push((name, filtered("filter::mipmapped", estimator, true)));
    }
    for (name, estimator, replaced, by) in [
        ("esm-fallback-not-counted", "filter::esm_fallback", "filter::tally", "filter::no_tally"),
        (
            "multiple-depth-n-buffer",
            "filter::multiple_depth",
            "filter::ends",
            "filter::ends_nbuffer",
        ),
    ] {
        let mut slots = filtered("filter::texels", estimator, false);
        slots.push(module(replaced, by));
        all.push((name, slots));
    }
    let parts = poisson_constants(&[[0.0, 1.0]; 4], 2.0);
    let parts =
        format!("{parts}\nconst BLOCK: u32 = 2u;\nconst TAPS: i32 = 1;\nconst PARTS: i32 = 1;");
    all.push((
        "interleaved",
        vec![loaded.clone(), module("estimator", "filter::interleaved"), source("config", parts)],
    ));
    let cubic = kernel("filter::kernel::cubic");
    all.push(("cubic", vec![loaded.clone(), separable.clone(), cubic]));
    let points = poisson_constants(&[[0.0, 1.0], [0.5, -0.5]], 2.0);
    let constants = source("config", format!("{points}\nconst PROBES: i32 = 1;"));
    all.push((
        "adaptive",
        vec![loaded.clone(), module("estimator", "filter::adaptive"), constants],
    ));
    let triangles = module("store", "map::triangles");
    let radius = |n: i32| source("config", format!("const RADIUS: i32 = {n};"));
    all.push(("object-id", vec![triangles.clone(), module("estimator", "map::object_id")]));
    for (name, path, n) in [
        ("polygon-id", "map::polygon_id", 0),
        ("polygon-id-3", "map::polygon_id", 1),
        ("triangle-depth", "map::triangle_depth", 1),
    ] {
        all.push((name, vec![triangles.clone(), module("estimator", path), radius(n)]));
    }
    all.extend(soft());
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

/// Estimators of soft shadows, with and without a pyramid and a tally.
fn soft() -> Vec<(&'static str, Vec<Slot>)> {
    let patch = Some("soft::micropatch");
    let quad = Some("soft::microquad");
    let exact = Some("soft::exact_microquad");
    let (mask_64, mask_256, mask_1024) =
        ((4, 4, 0x1111), (8, 4, 0x0101_0101), (16, 2, 0x0001_0001_u32));
    [
        ("pcss", "soft::pcss", None, true, mask_256),
        ("pcss-all-texels", "soft::pcss", None, false, mask_64),
        ("back-projection", "soft::back_projection", None, true, mask_256),
        ("radial-search", "soft::radial", None, true, mask_256),
        ("bitmask-micropatch-64", "soft::bitmask", patch, true, mask_64),
        ("bitmask-micropatch", "soft::bitmask", patch, false, mask_256),
        ("bitmask-microquad", "soft::bitmask", exact, true, mask_256),
        ("bitmask-microquad-1024", "soft::bitmask", quad, false, mask_1024),
        ("bitmask-layers", "soft::bitmask", exact, true, mask_256),
        ("bitmask-multiscale", "soft::bitmask", quad, true, mask_256),
        ("bitmask-y", "soft::bitmask", patch, true, mask_256),
        ("bitmask-emission", "soft::bitmask", patch, true, mask_256),
        ("bitmask-pattern", "soft::bitmask", quad, true, mask_256),
        ("bitmask-named", "soft::bitmask", patch, true, mask_256),
        ("pcss-named", "soft::pcss", None, true, mask_256),
    ]
    .map(|(name, estimator, occluders, full, (tiles, rows, repeat))| {
        let taps = if full { 16 } else { 0 };
        let constants = format!(
            "const HIERARCHY: bool = {full};\nconst UMBRA: bool = {full};\nconst BUDGET: i32 = 64;\n\
             const SEARCH: i32 = {taps};\nconst FILTER: i32 = {taps};\nconst CENTRE: f32 = 0.0;\nconst OWN: bool = {full};\n\
             const TURN: bool = true;\nconst TILES: i32 = {tiles};\nconst ROWS: i32 = {rows};\n\
             const REPEAT: u32 = {repeat}u;\nconst CLOSE: bool = {full};\n\
             const REACH: i32 = 2;\nconst TRIS: bool = {full};\nconst DEEPER: i32 = 3;\n\
             const EMISSION: i32 = 16;\nconst POINTS: i32 = 256;\nconst POINT_WORDS: i32 = 2;\n\
             const BUCKETS: i32 = 256;\nconst X_MASKS: i32 = 1280;\nconst Y_MASKS: i32 = 1794;"
        );
        let mut slots = vec![
            module("store", "common::depth_map"),
            module("map::through", "soft::through"),
            module("estimator", estimator),
            source("config", constants),
        ];
        slots.extend(occluders.map(|path| module("occluders", path)));
        match name {
            "bitmask-layers" => {}
            _ => slots.push(module("soft::deeper", "soft::no_deeper")),
        }
        match name {
            "bitmask-multiscale" => slots.push(module("soft::bounds", "soft::bounds_multiscale")),
            "bitmask-pattern" => slots.push(module("soft::mask", "soft::pattern_mask")),
            "bitmask-named" => slots.push(module("soft::named", "soft::named_triangles")),
            "pcss-named" => slots.extend([
                module("soft::named", "soft::named_triangles"),
                module("soft::contacts", "soft::named_contacts"),
            ]),
            "bitmask-emission" => slots.push(module("soft::counted", "soft::emitted")),
            "bitmask-y" => slots.push(module("soft::bounds", "soft::bounds_y")),
            _ => {}
        }
        if !full {
            slots.push(module("soft::bounds", "soft::no_bounds"));
            slots.push(module("soft::tally", "soft::no_tally"));
        }
        (name, slots)
    })
    .into_iter()
    .chain([vssm(true), vssm(false), single_sample(true), single_sample(false)])
    .collect()
}

/// Soft shadows from a single light sample, of either shadow depth.
fn single_sample(back: bool) -> (&'static str, Vec<Slot>) {
    let constants = format!(
        "const LINEAR: bool = true;\nconst BORDER: bool = {back};\nconst SCALE: f32 = 1.0;\nconst BIAS: f32 = 0.05;\n"
    );
    let mut slots = vec![
        module("store", "common::depth_map"),
        module("map::through", "soft::through"),
        module("estimator", "soft::width"),
        source("config", constants),
    ];
    if back {
        slots.push(module("soft::width_depth", "soft::width_depth_back"));
    }
    (if back { "single-sample-back" } else { "single-sample" }, slots)
}

/// Passes that make a shadow-width map.
fn widths() -> Vec<Permutation> {
    [
        ("doubling-first", "soft::width_doubling", "soft::width_of_map"),
        ("doubling", "soft::width_doubling", "soft::width_of_widths"),
        ("sweep-first", "soft::width_sweep", "soft::width_of_map"),
        ("sweep", "soft::width_sweep", "soft::width_of_widths"),
        ("euclid", "soft::width_euclid", "soft::width_of_widths"),
    ]
    .map(|(name, root, below)| Permutation {
        name: format!("soft-width-{name}"),
        root,
        slots: vec![
            module("below", below),
            source("width_config", "const STEPS: i32 = 84;\nconst NEIGHBOURS: i32 = 6;\n"),
        ],
    })
    .into()
}

/// Variance soft shadows, with and without a pyramid and a tally.
fn vssm(full: bool) -> (&'static str, Vec<Slot>) {
    let constants = format!(
        "const HIERARCHY: bool = {full};\nconst UMBRA: bool = {full};\nconst BUDGET: i32 = 64;\n\
         const PARTS: i32 = 4;\nconst STRIPS: i32 = 8;\nconst LEAST_VARIANCE: f32 = 1e-6;\n\
         const SCALE: f32 = 16383.0;\nconst MOST: f32 = 511.0;\nconst ROUNDING: f32 = 1e-4;\n"
    );
    let mut slots = vec![
        module("store", "soft::table_map"),
        module("map::through", "soft::through"),
        module("estimator", "soft::vssm"),
        source("config", constants),
    ];
    if !full {
        slots.push(module("soft::bounds", "soft::no_bounds"));
        slots.push(module("soft::tally", "soft::no_tally"));
    }
    (if full { "vssm" } else { "vssm-no-pyramid" }, slots)
}

/// Occlusion textures, which look up by themselves: by a table, counted too, an N-buffer and a mipmap.
fn occlusion_textures() -> Vec<(&'static str, Vec<Slot>)> {
    let constants = "const SLICES: i32 = 8;\nconst STRIPS: i32 = 8;\nconst FUSION: i32 = 0;\nconst SKIP: bool = true;\n";
    let counted = |store, prefilter, tally| {
        vec![
            module("map::through", "soft::occlusion"),
            source("config", constants),
            module("store", store),
            module("prefilter", prefilter),
            module("soft::tally", tally),
        ]
    };
    let all = |store, prefilter| counted(store, prefilter, "soft::no_window_tally");
    let levels = |square| {
        let mut slots = all("soft::slice_levels", "soft::covered_levels");
        slots.push(module("level_mean", square));
        slots
    };
    vec![
        ("table", all("soft::slice_table", "soft::covered_table")),
        ("tally", counted("soft::slice_table", "soft::covered_table", "soft::window_tally")),
        ("n-buffer", levels("soft::square_nbuffer")),
        ("mip", levels("soft::square_mip")),
    ]
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
