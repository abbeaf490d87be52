//! HC-11: a layout's seams are no worse than what the size of its texels there makes of a shadow's edge.

use antumbra_filter::PcfGrid;
use antumbra_gpu::{Frame, Gpu, GpuError, Technique};
use antumbra_map::twin::chart::{Chart, Isocube, Paraboloid, Perspective, tetrahedron};
use antumbra_map::{Arrange, Fitting, Layout, MapConfig, MapTechnique, Omni, SeenView, Sight};
use antumbra_measure::stability::Seams;
use antumbra_scene::Light;
use antumbra_tests::gpu;
use glam::{DMat3, DVec2, DVec3};

const LAYOUTS: [(Omni, Seams); 4] = [
    (Omni::Cube, Seams::Cube),
    (Omni::Tetrahedron, Seams::Tetrahedron),
    (Omni::Isocube, Seams::Isocube),
    (Omni::DualParaboloid, Seams::Paraboloid),
];

/// Rows of the frame of a chart around `axis`.
fn frame(axis: DVec3, up: DVec3) -> DMat3 {
    DMat3::from_cols(up.cross(axis), up, axis).transpose()
}

/// The nearest of the six directions of the axes.
fn nearest_axis(v: DVec3) -> DVec3 {
    let i = v.abs().max_position();
    DVec3::AXES[i] * v[i].signum()
}

/// Chart and frame in which a layout shows the direction `ray`.
fn chart_at(omni: Omni, ray: DVec3) -> (Box<dyn Chart>, DMat3) {
    let pole = ray.y.signum() * DVec3::Y;
    match omni {
        Omni::Cube => {
            let axis = nearest_axis(ray);
            let up = if axis.y == 0.0 { DVec3::Y } else { DVec3::Z };
            (Box::new(Perspective { tangents: DVec2::ONE }), frame(axis, up))
        }
        Omni::Tetrahedron => {
            // The twin's face, turned onto that of `ray`: from corners to corners.
            let (view, local) = tetrahedron();
            let signs = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)];
            let middles = signs.map(|(x, y)| DVec3::new(x, x * y, y));
            let face = (0..4).max_by(|i, j| middles[*i].dot(ray).total_cmp(&middles[*j].dot(ray)));
            let face = face.expect("four faces");
            let corners = [1, 2, 3].map(|i| -middles[(face + i) % 4].normalize());
            let of = |c: [DVec3; 3]| DMat3::from_cols(c[0], c[1], c[2]);
            (Box::new(view), of(local) * of(corners).inverse())
        }
        Omni::Isocube if ray.y.abs() > 2.0 / 3.0 => (Box::new(Isocube::Cap), frame(pole, DVec3::Z)),
        Omni::Isocube => (Box::new(Isocube::Belt), frame(nearest_axis(ray.with_y(0.0)), DVec3::Y)),
        Omni::DualParaboloid | Omni::WarpedParaboloid => {
            (Box::new(Paraboloid), frame(pole, DVec3::Z))
        }
    }
}

/// Mean distance between a direction and its texel's centre, across an edge with unit normal `across`, in units of the
/// chart times the map's side.
///
/// The offset is a u + b v, with a and b the texel's sides as seen across the edge and u, v spread evenly within half a unit; for
/// |a| >= |b| the mean of its size is |a| / 4 + b^2 / (12 |a|). What an estimator is wrong by at an edge goes with it.
fn offset(omni: Omni, ray: DVec3, across: DVec3) -> f64 {
    let (chart, frame) = chart_at(omni, ray);
    let (at, step) = (chart.to_chart(frame * ray), 1e-5);
    let side = |d: DVec2| {
        let moved = chart.direction_at(at + step * d) - chart.direction_at(at - step * d);
        (frame * across).dot(moved / (2.0 * step)).abs()
    };
    let (a, b) = (side(DVec2::X), side(DVec2::Y));
    let (a, b) = (a.max(b), a.min(b));
    a / 4.0 + b * b / (12.0 * a)
}

/// The error beside the seam as a share of that elsewhere: as it is, and for texels of one size.
fn shares(gpu: &Gpu, (omni, seams): (Omni, Seams), mut map: MapTechnique, size: u32) -> [f64; 2] {
    let technique: &mut dyn Technique = &mut map;
    let errors = seams.errors(gpu, technique, size, |ray, across| offset(omni, ray, across));
    let [at_seam, elsewhere] = errors.expect("measured");
    let found = at_seam.found / elsewhere.found;
    [found, found / (at_seam.due / elsewhere.due)]
}

fn technique(gpu: &Gpu, map: &MapConfig, side: u32) -> MapTechnique {
    let estimator = PcfGrid { map: *map, side }.estimator().expect("a valid config");
    MapTechnique::new(gpu, map, estimator).expect("a valid config")
}

/// A layout whose views end at their borders, whatever kernels reach.
#[derive(Debug)]
struct Unguarded(Box<dyn Arrange>);

impl Arrange for Unguarded {
    fn layout(&self, light: &Light) -> Layout {
        self.0.layout(light)
    }

    fn fit(
        &self,
        frame: &Frame<'_>,
        hull: &[DVec3],
        sight: Option<&Sight<'_>>,
        fitting: &Fitting,
    ) -> Result<Vec<SeenView>, GpuError> {
        self.0.fit(frame, hull, sight, &Fitting { guard: 0, ..*fitting })
    }
}

#[test]
fn seams_are_no_worse_than_their_texels() {
    let gpu = gpu();
    let mut faults = Vec::new();
    for layout in LAYOUTS {
        // On smaller maps a kernel is as wide as a body, and errors end with the body.
        for (size, least) in [(256, 0.85), (512, 0.9), (1024, 0.9)] {
            let map = MapConfig { size, omni: layout.0, ..MapConfig::default() };
            let [found, share] = shares(&gpu, layout, technique(&gpu, &map, 3), size);
            if found > 1.1 || !(least..1.1).contains(&share) {
                faults.push(format!("{layout:?}, {size}: {found}, {share} for texels of one size"));
            }
        }
    }
    assert!(faults.is_empty(), "at the seam as a share of elsewhere:\n{}", faults.join("\n"));
}

#[test]
fn seams_without_a_guard_band_are_noticed() {
    let gpu = gpu();
    // A tetrahedron's views and paraboloids go on beyond their seams by themselves.
    for layout in [LAYOUTS[0], LAYOUTS[2]] {
        let map = MapConfig { size: 1024, omni: layout.0, ..MapConfig::default() };
        let [_, guarded] = shares(&gpu, layout, technique(&gpu, &map, 7), 1024);
        let map = technique(&gpu, &map, 7).rearranged(|omni| Ok(Box::new(Unguarded(omni))));
        let [_, without] = shares(&gpu, layout, map.expect("a valid layout"), 1024);
        assert!((0.9..1.1).contains(&guarded), "{layout:?}: {guarded}");
        // Repeated rows of texels: kernels see less of an edge that runs along the seam.
        assert!(!(0.9..1.1).contains(&without), "{layout:?}: no band, and still {without}");
    }
}
