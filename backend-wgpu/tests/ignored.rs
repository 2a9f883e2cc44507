//! Every test that may open a device is marked, so that it is ignored, with the reason, where there is no
//! adapter; and the tests of real scenes likewise where there are no scenes.

use std::fs;
use std::path::Path;

const NO_GPU: &str = "#[cfg_attr(no_gpu, ignore = \
                      \"no Vulkan adapter and none could be installed\")]";
const NO_SCENES: &str = "#[cfg_attr(no_scenes, ignore = \
                         \"no scenes folder; set SPLITPLANE_SCENES\")]";

/// Tests that open no device of this machine, by file.
const WITHOUT_DEVICE: [(&str, &[&str]); 7] = [
    ("ignored", &["tests_that_need_a_device_are_marked", "tests_of_real_scenes_are_marked"]),
    ("hits", &["rays_have_no_memory_of_workgroups"]),
    ("selftest", &["the_small_tree_is_the_cpus"]),
    ("point_build", &["the_schedule_makes_the_trees_of_the_serial_builder"]),
    // On wgpu's `noop` device, as those of the next file.
    ("ray_stacks", &["lean_kernels_have_their_stack_in_the_memory_of_the_workgroup"]),
    (
        "driver",
        &[
            "a_driver_that_takes_memory_without_end_is_left",
            "a_device_is_not_opened_without_time",
            "opening_ends_at_the_first_pipeline_that_stalls",
            "a_report_says_what_the_driver_was_doing",
            "a_kernel_of_the_builder_that_stalls_is_named",
        ],
    ),
    (
        "faults",
        &[
            "no_adapter",
            "a_wrong_adapter_name_lists_those_there_are",
            "limits_below_the_defaults_of_webgpu",
            "a_self_test_that_fails_makes_an_adapter_unusable",
            "default_limits_are_requested_whatever_there_is",
            "buffers_over_a_limit_are_refused_before_wgpu_sees_them",
            "no_memory_is_an_error_and_the_device_lives_on",
            "a_lost_device_is_an_error_everywhere",
            "a_lost_device_of_the_host_is_noticed_and_the_host_is_told_too",
            "a_loss_between_mapping_and_reading_is_a_loss",
            "a_panic_of_wgpu_about_a_lost_device_is_a_loss",
            "a_panic_for_another_reason_stays_a_panic",
            "errors_outside_any_scope_are_found_at_the_next_check",
            "on_a_device_of_the_host_nothing_of_ours_reaches_its_callback",
            "text_that_is_no_wgsl_is_refused_with_the_name_of_the_shader",
            "a_buffer_can_be_read_again_after_reading_it_failed",
        ],
    ),
];

/// A test as its text.
struct Test {
    file: String,
    name: String,
    /// The lines from `#[test]` to the name.
    attributes: Vec<String>,
    /// The lines to the brace that closes it.
    body: String,
}

/// All tests of this folder.
fn tests() -> Vec<Test> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests");
    let mut tests = Vec::new();
    for entry in fs::read_dir(folder).expect("the folder of the tests") {
        let path = entry.expect("an entry").path();
        if path.extension().is_none_or(|extension| extension != "rs") {
            continue;
        }
        let file = path.file_stem().expect("a name").to_string_lossy().into_owned();
        let text = fs::read_to_string(&path).expect("text");
        let mut lines = text.lines();
        while lines.by_ref().any(|line| line == "#[test]") {
            let mut attributes = Vec::new();
            let name = loop {
                let line = lines.next().expect("a function after #[test]");
                match line.strip_prefix("fn ").and_then(|rest| rest.split_once('(')) {
                    Some((name, _)) => break name.to_owned(),
                    None => attributes.push(line.to_owned()),
                }
            };
            let body: Vec<&str> = lines.by_ref().take_while(|&line| line != "}").collect();
            tests.push(Test { file: file.clone(), name, attributes, body: body.join("\n") });
        }
    }
    assert!(tests.len() > 50, "only {} tests were found", tests.len());
    tests
}

/// The tests for which `wrong` is true, by file and name.
fn names(tests: &[Test], wrong: impl Fn(&Test) -> bool) -> Vec<String> {
    let wrong = tests.iter().filter(|test| wrong(test));
    wrong.map(|test| format!("{}::{}", test.file, test.name)).collect()
}

#[test]
fn tests_that_need_a_device_are_marked() {
    let listed = |test: &Test| {
        WITHOUT_DEVICE
            .iter()
            .any(|(file, names)| *file == test.file && names.contains(&test.name.as_str()))
    };
    let marked = |test: &Test| test.attributes.iter().any(|line| line == NO_GPU);
    let tests = tests();
    let unmarked = names(&tests, |test| !marked(test) && !listed(test));
    assert!(unmarked.is_empty(), "add {NO_GPU}\nto {unmarked:#?}");
    let opening = names(&tests, |test| {
        listed(test)
            && ["common::", "own_gpu(", "Gpu::open("]
                .iter()
                .any(|opening| test.body.contains(opening))
    });
    let opening = elsewhere(&opening);
    assert!(opening.is_empty(), "these open a device: {opening:#?}");
    let stale =
        WITHOUT_DEVICE.iter().flat_map(|(file, names)| names.iter().map(move |n| (file, n)));
    for (file, name) in stale {
        let there = tests.iter().any(|test| test.file == *file && test.name == *name);
        assert!(there, "there is no test {file}::{name}");
    }
}

/// Without the tests of this file, which name what they look for.
fn elsewhere(found: &[String]) -> Vec<&String> {
    found.iter().filter(|name| !name.starts_with("ignored::")).collect()
}

#[test]
fn tests_of_real_scenes_are_marked() {
    let marked = |test: &Test| test.attributes.iter().any(|line| line == NO_SCENES);
    let unmarked = names(&tests(), |test| test.body.contains("scenes::real(") && !marked(test));
    let unmarked = elsewhere(&unmarked);
    assert!(unmarked.is_empty(), "add {NO_SCENES}\nto {unmarked:#?}");
}
