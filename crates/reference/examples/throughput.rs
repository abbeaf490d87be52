//! Rays per second on one core, for a scene file:
//!
//! ```text
//! cargo run --release -p antumbra-reference --example throughput -- city.glb
//! ```
//!
//! A million rays from random points of the scene's bounds in random directions, and a million shadow
//! rays from random points of its surfaces towards a sun and a lamp above the middle. Prints the best
//! and the median of nine runs on one thread, of `Tracer::occluded_all` and of one call for each ray.

#![allow(clippy::print_stdout, reason = "printing is what this program is for")]

use std::path::Path;
use std::time::Instant;

use antumbra_reference::{Ray, Tracer};
use antumbra_scene::{LoadOptions, load};
use glam::{DVec3, Vec3};

const COUNT: usize = 1_000_000;

/// SplitMix64 (Steele, Lea and Flood 2014), as a number in [0, 1).
fn unit(state: &mut u64) -> f32 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (*state ^ (*state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x ^ (x >> 31)) >> 40) as f32 / (1 << 24) as f32
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("name a scene file: throughput <file>")?;
    let (scene, _) = load(Path::new(&path), &LoadOptions::default())?;
    let triangles = scene.triangles(scene.origin())?;
    let start = Instant::now();
    let tracer = Tracer::new(&triangles)?;
    let ms = 1e3 * start.elapsed().as_secs_f64();
    println!(
        "{} triangles, tree in {ms:.0} ms, {:?} instructions",
        triangles.triangles.len(),
        tracer.instructions()
    );

    let low = triangles.positions.iter().copied().reduce(Vec3::min).unwrap_or_default();
    let high = triangles.positions.iter().copied().reduce(Vec3::max).unwrap_or_default();
    let mut state = 1;
    let mut number = || unit(&mut state);
    let random: Vec<Ray> = (0..COUNT)
        .map(|_| {
            let origin = low + (high - low) * Vec3::new(number(), number(), number());
            // Uniform over the sphere (Archimedes).
            let (y, angle) = (2.0 * number() - 1.0, std::f32::consts::TAU * number());
            let r = (1.0 - y * y).sqrt();
            let direction = Vec3::new(r * angle.cos(), y, r * angle.sin());
            Ray { origin, direction, t_max: f32::INFINITY }
        })
        .collect();
    measure("random rays", &tracer, &random);

    // Points uniform over the area: by the running sum of areas.
    let corners =
        |i: usize| triangles.triangles[i].map(|v| triangles.positions[v as usize].as_dvec3());
    let mut sum = 0.0;
    let areas: Vec<f64> = (0..triangles.triangles.len())
        .map(|i| {
            let [a, b, c] = corners(i);
            sum += (b - a).cross(c - a).length();
            sum
        })
        .collect();
    let lamp = DVec3::new(0.0, f64::from(2.0 * high.y - low.y), 0.0)
        + 0.5 * (low + high).as_dvec3() * DVec3::new(1.0, 0.0, 1.0);
    let mut surface = |towards: &dyn Fn(DVec3) -> DVec3, t_max: f32| -> Vec<Ray> {
        (0..COUNT)
            .map(|_| {
                let pick = f64::from(number()) * sum;
                let index = areas.partition_point(|&a| a < pick).min(areas.len() - 1);
                let [a, b, c] = corners(index);
                let (s, t) = (f64::from(number()).sqrt(), f64::from(number()));
                let p = a + (b - a) * (s * (1.0 - t)) + (c - a) * (s * t);
                let normal = (b - a).cross(c - a).normalize_or_zero();
                let side = 1e-5_f64.copysign(normal.dot(towards(p)));
                let origin = p + normal * side * f64::from(tracer.radius());
                Ray { origin: origin.as_vec3(), direction: towards(origin).as_vec3(), t_max }
            })
            .collect()
    };
    let sun = surface(&|_| DVec3::new(0.4, 0.8, 0.3), f32::INFINITY);
    measure("shadow rays to a sun", &tracer, &sun);
    let point = surface(&|p| lamp - p, 1.0);
    measure("shadow rays to a lamp", &tracer, &point);
    Ok(())
}

fn measure(name: &str, tracer: &Tracer, rays: &[Ray]) {
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    let batch = || tracer.occluded_all(rays).into_iter().filter(|&blocked| blocked).count();
    let each = || rays.iter().filter(|r| tracer.occluded(r.origin, r.direction, r.t_max)).count();
    let rate = |run: &(dyn Fn() -> usize + Sync)| {
        let mut seconds: Vec<f64> = (0..9)
            .map(|_| {
                let start = Instant::now();
                one_thread.install(run);
                start.elapsed().as_secs_f64()
            })
            .collect();
        seconds.sort_by(f64::total_cmp);
        let millions = rays.len() as f64 * 1e-6;
        format!("{:.2} (best {:.2})", millions / seconds[4], millions / seconds[0])
    };
    println!(
        "{name}: {} million rays/s on one core in a batch, {} one by one; {:.1} % blocked",
        rate(&batch),
        rate(&each),
        100.0 * each() as f64 / rays.len() as f64
    );
}
