//! dev only
use antumbra_reference::{Ray, Tracer};
use antumbra_scene::Triangles;
use glam::Vec3;
fn read(p: &str) -> Vec<f32> {
    std::fs::read(p).unwrap().chunks_exact(4).map(|c| f32::from_le_bytes(c.try_into().unwrap())).collect()
}
fn main() {
    let v = |p: &str| -> Vec<Vec3> { read(p).chunks_exact(3).map(Vec3::from_slice).collect() };
    let pos = v("/tmp/rt/pos.f32");
    let idx: Vec<[u32; 3]> = std::fs::read("/tmp/rt/idx.u32").unwrap().chunks_exact(12).map(|c| std::array::from_fn(|i| u32::from_le_bytes(c[4 * i..4 * i + 4].try_into().unwrap()))).collect();
    let tris = Triangles { positions: pos, triangles: idx, ..Default::default() };
    let t = std::time::Instant::now();
    let tracer = Tracer::new(&tris).unwrap();
    println!("build {:?} {tracer:?}", t.elapsed());
    for s in ["a", "b", "c"] {
        let o = v(&format!("/tmp/rt/{s}_o.f32"));
        let d = v(&format!("/tmp/rt/{s}_d.f32"));
        let tm = if s == "c" { 1.0 - 1e-6 } else { f32::INFINITY };
        let rays: Vec<Ray> = o.iter().zip(&d).map(|(&origin, &direction)| Ray { origin, direction, t_max: tm }).collect();
        let mut times = vec![];
        let mut out = vec![0u8; rays.len()];
        for _ in 0..9 {
            let t = std::time::Instant::now();
            for (r, o) in rays.iter().zip(&mut out) {
                *o = tracer.occluded(r.origin, r.direction, r.t_max).into();
            }
            times.push(t.elapsed().as_secs_f64());
        }
        times.sort_by(f64::total_cmp);
        let n = rays.len() as f64 * 1e-6;
        let e = std::fs::read(format!("/tmp/rt/{s}_embree.u8")).unwrap_or_default();
        let more = out.iter().zip(&e).filter(|(a, b)| a > b).count();
        let less = out.iter().zip(&e).filter(|(a, b)| a < b).count();
        std::fs::write(format!("/tmp/rt/{s}_ours.u8"), &out).unwrap();
        println!("ours {s}: best {:.2} median {:.2} Mrays/s, occluded {:.5}, only ours {more}, only embree {less}", n / times[0], n / times[4], out.iter().map(|&x| f64::from(x)).sum::<f64>() / out.len() as f64);
    }
}
