//! CPU cost of fitting a light's views, per frame.

use antumbra_map::{Fitting, fit};
use antumbra_scene::Light;
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
    let fitting = Fitting { origin: DVec3::ZERO, size: 2048, guard: 4, receivers: false };
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

criterion_group!(benches, fits);
criterion_main!(benches);
