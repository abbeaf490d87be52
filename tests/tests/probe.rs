//! The probe: what the library relies on holds on the device at hand, however it was created.

use antumbra_gpu::{Gpu, GpuError, Probe, Verdict, probe};
use antumbra_tests::gpu;

/// A device as a caller makes it, on the adapter of the other tests.
fn device_with(features: wgpu::Features, limits: wgpu::Limits) -> Option<Gpu> {
    let name = gpu().info.name;
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
    let adapter = adapters.into_iter().find(|a| a.get_info().name == name)?;
    let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
        required_features: features,
        required_limits: limits,
        ..Default::default()
    }))
    .ok()?;
    Some(Gpu::from_device(device, queue))
}

#[test]
fn everything_holds_on_the_own_device() {
    let gpu = gpu();
    let found = probe(&gpu).expect("the device is not lost");
    assert!(found.all_hold(), "{found}");
    assert_eq!(gpu.check(), Ok(()), "errors reported by the probe");
    // What can be used is used.
    for (name, feature) in [
        ("depth clamp", wgpu::Features::DEPTH_CLIP_CONTROL),
        ("f32 filtering", wgpu::Features::FLOAT32_FILTERABLE),
        ("timestamps", wgpu::Features::TIMESTAMP_QUERY),
        ("multiview", wgpu::Features::MULTIVIEW),
    ] {
        let check = found.find(name).expect("every check is listed");
        let enabled = gpu.device.features().contains(feature);
        assert_eq!(check.verdict != Verdict::Absent, enabled, "{name}: {check:?}");
    }
}

#[test]
fn everything_holds_on_a_device_with_default_limits_and_no_features() {
    let gpu = device_with(wgpu::Features::empty(), wgpu::Limits::default()).expect("a device");
    let found = probe(&gpu).expect("the device is not lost");
    assert!(found.all_hold(), "{found}");
    let absent = found.checks.iter().filter(|c| c.verdict == Verdict::Absent).count();
    assert_eq!(absent, 4, "without features, the four optional checks are absent: {found}");
}

#[test]
fn an_offered_feature_is_drawn_before_it_is_believed() {
    let limits = wgpu::Limits { max_multiview_view_count: 2, ..wgpu::Limits::default() };
    let Some(gpu) = device_with(wgpu::Features::MULTIVIEW, limits) else {
        return;
    };
    let found = probe(&gpu).expect("the device is not lost");
    let check = found.find("multiview").expect("every check is listed");
    assert_ne!(check.verdict, Verdict::Absent, "the feature is enabled");
    let others = found.checks.iter().filter(|c| c.name != "multiview");
    for other in others {
        assert_ne!(other.verdict, Verdict::Fails, "{other:?}");
    }
}

#[test]
fn a_lost_device_is_an_error() {
    let gpu = gpu();
    gpu.device.destroy();
    let outcome = probe(&gpu);
    let lost = matches!(outcome, Err(GpuError::DeviceLost { .. }));
    // A device that still answers after `destroy` fails its checks instead.
    assert!(lost || outcome.is_ok_and(|found| !found.all_hold()), "a destroyed device passed");
}

#[test]
fn the_report_survives_json() {
    let found = probe(&gpu()).expect("the device is not lost");
    let json = serde_json::to_string(&found).expect("it serialises");
    let back: Probe = serde_json::from_str(&json).expect("it reads back");
    assert_eq!(back, found, "through {json}");
}
