//! Keeps two lines of Mesa's off the terminal.
//!
//! Its layer that orders devices looks for a desktop whenever Vulkan is opened, and where there is none says `error:
//! XDG_RUNTIME_DIR is invalid or not set` each time. We order devices ourselves. The layer stays away where
//! `NODEVICE_SELECT` is in the environment when it is loaded. A process cannot safely change its own environment while
//! others may read it, so the program replaces itself by itself with another one: same process, same files.

/// Starts the program anew without the layer, where it would only complain. Comes back where that is not so, or fails.
#[cfg(all(target_os = "linux", feature = "wgpu"))]
pub(super) fn silence() {
    use std::env;
    use std::os::unix::process::CommandExt;
    use std::path::Path;
    use std::process::Command;

    let complains =
        env::var_os("XDG_RUNTIME_DIR").is_none_or(|path| !Path::new(&path).is_absolute());
    // That this was done, or that someone uses the layer.
    let deciding = ["NODEVICE_SELECT", "MESA_VK_DEVICE_SELECT", "DRI_PRIME"];
    if !complains || deciding.iter().any(|name| env::var_os(name).is_some()) {
        return;
    }
    let mut arguments = env::args_os();
    if let (Ok(program), Some(name)) = (env::current_exe(), arguments.next()) {
        // Only a failure comes back, and then the lines are all that is lost.
        let _failed =
            Command::new(program).arg0(name).args(arguments).env("NODEVICE_SELECT", "1").exec();
    }
}

#[cfg(not(all(target_os = "linux", feature = "wgpu")))]
pub(super) fn silence() {}
