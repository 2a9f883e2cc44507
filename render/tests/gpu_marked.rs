//! Every test that opens a device is marked, so that it is ignored, with the reason, where there is no
//! adapter.

use std::path::Path;

const NO_GPU: &str = "#[cfg_attr(no_gpu, ignore = \
                      \"no Vulkan adapter and none could be installed\")]";

#[test]
fn tests_that_need_a_device_are_marked() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests");
    let mut tests = 0;
    for name in [
        "gpu_compressed.rs",
        "gpu_exact.rs",
        "gpu_halves.rs",
        "gpu_light.rs",
        "gpu_lockstep.rs",
        "gpu_pictures.rs",
        "gpu_ray_stacks.rs",
    ] {
        let text = std::fs::read_to_string(folder.join(name)).expect("a file of tests");
        let mut lines = text.lines();
        while lines.by_ref().any(|line| line == "#[test]") {
            assert_eq!(lines.next(), Some(NO_GPU), "{name}");
            tests += 1;
        }
    }
    assert!(tests > 10, "only {tests} tests were found");
}
