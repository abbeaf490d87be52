//! CPU cost of fitting a light's views, per frame.

use antumbra_gpu::ViewCamera;
use antumbra_map::{Fitting, Sight, VisibleRegion, fit, fit_seen};
use antumbra_scene::{Bounds, Camera, Light};
use criterion::{Criterion, criterion_group, criterion_main};
use glam::DVec3;

/// Corners of the boxes of a town of 20 x 20 houses.
fn hull() -> Vec<DVec3> {
    let mut points = Vec::new();
    for (x, z) in (0..20).flat_map(|x| (0..20).map(move |z| (f64::from(x), f64::from(z)))) {
        let height = 1.0 + (x * 7.0 + z * 3.0) % 5.0;
        for corner in 0..8 {
            let bit = |i: i32| f64::from(corner >> i & 1);
            points.push(DVec3::new(
                x * 10.0 + 6.0 * bit(0),
                height * bit(1),
                z * 10.0 + 6.0 * bit(2),
            ));
        }
    }
    points
}

fn fits(c: &mut Criterion) {
    let hull = hull();
    let fitting = Fitting { origin: DVec3::ZERO, size: 2048, guard: 4, receivers: false, grid: 1 };
    let lights = [
        ("directional", Light::sun(0.8, 0.6, 0.0)),
        (
            "spot",
            Light::Spot {
                position: DVec3::new(-50.0, 90.0, -50.0),
                direction: DVec3::new(0.7, -0.4, 0.7).normalize(),
                outer_angle: 0.6,
            },
        ),
        ("point", Light::Point { position: DVec3::new(100.0, 3.0, 100.0) }),
    ];
    let mut group = c.benchmark_group("fit");
    for (name, light) in lights {
        group.bench_function(name, |b| b.iter(|| fit(&light, &hull, &fitting)));
    }
    group.finish();
}

/// To what a camera in the street sees, with every house in `pieces` boxes: the clusters of its triangles.
fn fits_of_clusters(c: &mut Criterion) {
    let hull = hull();
    let fitting = Fitting { origin: DVec3::ZERO, size: 2048, guard: 4, receivers: false, grid: 1 };
    let eye = DVec3::new(88.0, 1.7, 100.0);
    let target = eye + DVec3::new(1.0, 0.0, 0.3);
    let camera = Camera { eye, target, up: DVec3::Y, fov_y: 1.0, near: 0.05 };
    let view = ViewCamera { clip: camera.view_projection(DVec3::ZERO, 1.5), eye };
    let light = Light::sun(0.8, 0.6, 0.0);
    let mut group = c.benchmark_group("fit to what is seen");
    for pieces in [10, 20, 40] {
        let mut boxes = Vec::new();
        for corners in hull.chunks_exact(8) {
            let Bounds { min, max } = Bounds::of(corners.iter().copied());
            let share = (max - min) / f64::from(pieces);
            boxes.extend((0..pieces).map(|i| Bounds {
                min: min.with_y(min.y + share.y * f64::from(i)),
                max: max.with_y(min.y + share.y * f64::from(i + 1)),
            }));
        }
        group.bench_function(format!("{} clusters", boxes.len()), |b| {
            b.iter(|| {
                let region = VisibleRegion::new(&view, &boxes, DVec3::ZERO)?;
                let sight = Sight { region: &region, casters: &boxes };
                fit_seen(&light, &hull, Some(&sight), &fitting).ok()
            });
        });
    }
    group.finish();
}

criterion_group!(benches, fits, fits_of_clusters);
criterion_main!(benches);
