//! Prefix sums on the GPU against a loop.

use antumbra_gpu::{Gpu, Scan, read_buffer, wgpu};
use antumbra_tests::gpu;

/// The sums of values that differ from place to place.
fn check(gpu: &Gpu, scan: &mut Scan, count: u32) {
    let values: Vec<u32> =
        (0..count).map(|i| (i.wrapping_mul(2_654_435_761) >> 28) + i % 3).collect();
    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
    let buffer = gpu.buffer("values", bytemuck::cast_slice(&values), usage);
    scan.prepare(gpu, &buffer, count).expect("it fits");
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    scan.encode(&mut encoder.begin_compute_pass(&Default::default()));
    gpu.queue.submit([encoder.finish()]);
    let bytes = read_buffer(gpu, &buffer, u64::from(count) * 4).expect("read back");
    let found: &[u32] = bytemuck::cast_slice(&bytes);
    let mut sum = 0;
    for (i, value) in values.iter().enumerate() {
        assert_eq!(found[i], sum, "before value {i} of {count}");
        sum += value;
    }
}

#[test]
fn each_value_becomes_the_sum_of_those_before_it() {
    let gpu = gpu();
    let mut scan = Scan::new(&gpu).expect("it links");
    // One block and its borders, two levels, three levels, and small again.
    for count in [1, 2, 3, 4, 5, 255, 1023, 1024, 1025, 4097, 1 << 20, (1 << 20) + 1, 7] {
        check(&gpu, &mut scan, count);
    }
    assert_eq!(gpu.check(), Ok(()), "no error from wgpu");
}
