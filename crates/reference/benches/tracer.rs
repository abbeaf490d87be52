//! Speed of the tree's construction and of any-hit rays, on a generated town, on one thread.

use std::hint::black_box;

use antumbra_reference::{Ray, Tracer};
use antumbra_scene::Triangles;
use criterion::{Criterion, Throughput};
use glam::Vec3;

/// SplitMix64 (Steele, Lea and Flood 2014), as a number in [0, 1).
fn unit(state: &mut u64) -> f32 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (*state ^ (*state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x ^ (x >> 31)) >> 40) as f32 / (1 << 24) as f32
}

/// Boxes of random size on a floor of 16 m: 48,002 triangles.
fn town() -> Triangles {
    let mut list = Triangles::default();
    let mut random = 1;
    let mut cuboid = |low: Vec3, high: Vec3| {
        let n = list.positions.len() as u32;
        for i in 0..8 {
            let pick =
                |bit: u32, axis: usize| if i >> bit & 1 == 0 { low[axis] } else { high[axis] };
            list.positions.push(Vec3::new(pick(0, 0), pick(1, 1), pick(2, 2)));
        }
        for [a, b, c, d] in
            [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]]
        {
            list.triangles.extend([[n + a, n + b, n + c], [n + a, n + c, n + d]]);
        }
    };
    for _ in 0..4000 {
        let mut number = || unit(&mut random);
        let low = Vec3::new(16.0 * number() - 8.0, 0.0, 16.0 * number() - 8.0);
        let size = Vec3::new(number(), 4.0 * number(), number()) * 0.4;
        cuboid(low, low + size);
    }
    let n = list.positions.len() as u32;
    list.positions.extend(
        [(-8.0, -8.0), (8.0, -8.0), (8.0, 8.0), (-8.0, 8.0)].map(|(x, z)| Vec3::new(x, 0.0, z)),
    );
    list.triangles.extend([[n, n + 1, n + 2], [n, n + 2, n + 3]]);
    list
}

fn main() {
    let triangles = town();
    let tracer = Tracer::new(&triangles).expect("valid triangles");
    let mut random = 2;
    let mut number = || unit(&mut random);
    let mut point = || Vec3::new(16.0 * number() - 8.0, 1.7 * number(), 16.0 * number() - 8.0);
    let count = 100_000;
    let rays: Vec<Ray> = (0..count)
        .map(|_| Ray { origin: point(), direction: point() - point(), t_max: f32::INFINITY })
        .collect();
    let lamp = Vec3::new(0.0, 6.0, 0.0);
    let shadow: Vec<Ray> = (0..count)
        .map(|_| {
            let origin = point() * Vec3::new(1.0, 0.0, 1.0) + Vec3::Y * 1e-4;
            Ray { origin, direction: lamp - origin, t_max: 1.0 }
        })
        .collect();

    let mut criterion = Criterion::default().sample_size(20).configure_from_args();
    let mut group = criterion.benchmark_group("tracer");
    group.throughput(Throughput::Elements(triangles.triangles.len() as u64));
    group.bench_function("build", |b| b.iter(|| Tracer::new(black_box(&triangles))));
    group.throughput(Throughput::Elements(count));
    for (name, rays) in [("any hit, random rays", &rays), ("any hit, shadow rays", &shadow)] {
        group.bench_function(name, |b| {
            b.iter(|| {
                rays.iter().filter(|r| tracer.occluded(r.origin, r.direction, r.t_max)).count()
            });
        });
    }
    group.finish();
    criterion.final_summary();
}
