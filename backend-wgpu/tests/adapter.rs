//! Whether this machine has an adapter at all. `scripts/test.sh` runs this test first and sets up a
//! software adapter when it fails.

use splitplane_wgpu::{Adapters, Parity, adapters};

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn there_is_a_gpu_adapter() {
    let found = Adapters::find();
    let usable = found.list().iter().find(|adapter| adapter.unusable().is_none());
    let reasons: Vec<_> = found.list().iter().map(|a| (a.name(), a.unusable())).collect();
    assert!(usable.is_some(), "no GPU adapter can be used: {reasons:?}; run scripts/test.sh");
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn an_adapter_is_reported_with_what_the_test_says() {
    let reports = adapters(|gpu| Ok(Parity::Structural(gpu.info().name.clone())));
    let usable: Vec<_> = reports.iter().filter(|report| report.unusable.is_none()).collect();
    assert!(!usable.is_empty(), "{reports:?}");
    for report in usable {
        assert_eq!(report.parity, Some(Parity::Structural(report.name.clone())));
        assert!(report.limits.max_storage_buffers_per_shader_stage >= 8, "{report:?}");
        assert!(!report.name.is_empty() && report.backend != "noop", "{report:?}");
    }
}
