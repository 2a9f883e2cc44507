//! What a user sees of a bug: one sentence instead of a backtrace.

use super::failure::BUG;
use splitplane::backend::panic_is_caught;
use std::panic;

/// From now on a panic on any thread ends the program with code 70, unless it only reports the loss
/// of a device.
pub(super) fn install() {
    panic::set_hook(Box::new(|info| {
        if panic_is_caught() {
            return;
        }
        let place = info.location().map(|at| format!(" at {}:{}", at.file(), at.line()));
        let payload = info.payload();
        let what = payload.downcast_ref::<&str>().copied();
        let what = what.or(payload.downcast_ref::<String>().map(String::as_str));
        let what = what.unwrap_or("no message");
        super::output::error(&format!(
            "this is a bug in splitplane{}: {what}; please report this line with the command",
            place.unwrap_or_default()
        ));
        std::process::exit(BUG.into());
    }));
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;

    const CHILD: &str = "SPLITPLANE_TEST_PANICS";

    /// Runs itself in a process of its own, since the hook ends it.
    #[test]
    fn a_panic_is_one_sentence_and_code_70() {
        if std::env::var_os(CHILD).is_some() {
            install();
            let _ = rayon_like_thread(|| panic!("a test\nof two lines")).join();
            unreachable!("the hook ends the process");
        }
        let output = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "bug::tests::a_panic_is_one_sentence_and_code_70", "--nocapture"])
            .env(CHILD, "1")
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(70));
        let error = String::from_utf8(output.stderr).unwrap();
        assert_eq!(error.lines().count(), 1, "{error}");
        assert!(error.contains("please report") && !error.contains("backtrace"), "{error}");
    }

    /// Likewise in a process of its own: the hook would end it.
    #[cfg(feature = "wgpu")]
    #[test]
    fn a_panic_of_wgpu_about_a_lost_device_is_no_bug() {
        use splitplane::gpu::{Gpu, GpuError};
        if std::env::var_os(CHILD).is_some() {
            install();
            let (device, queue) = wgpu::Device::noop(&wgpu::DeviceDescriptor::default());
            let gpu = Gpu::borrow(device.clone(), queue.clone());
            queue.on_submitted_work_done(move || {
                device.destroy();
                panic!("Error in Device::poll: Parent device is lost");
            });
            assert!(matches!(gpu.wait(), Err(GpuError::Lost { .. })));
            return;
        }
        let output = Command::new(std::env::current_exe().unwrap())
            .args([
                "--exact",
                "bug::tests::a_panic_of_wgpu_about_a_lost_device_is_no_bug",
                "--nocapture",
            ])
            .env(CHILD, "1")
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(0));
        // A name that no test has would end so, too.
        assert!(String::from_utf8(output.stdout).unwrap().contains("1 passed"));
        assert_eq!(String::from_utf8(output.stderr).unwrap(), "");
    }

    fn rayon_like_thread(work: fn()) -> std::thread::JoinHandle<()> {
        std::thread::spawn(work)
    }
}
