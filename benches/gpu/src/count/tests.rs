//! The counts of a few scenes, pinned: a worse figure shows as a difference. Take them again with `INSTA_UPDATE=always`.

use splitplane::Preset;
use splitplane::gpu::{Gpu, OpenOptions};
use splitplane::scene::Scene;

use super::build::count;
use super::device::Counter;
use super::table::table;

fn counter() -> Counter {
    let adapter = std::env::var("SPLITPLANE_ADAPTER").ok();
    let options = OpenOptions { default_limits: true, adapter, ..OpenOptions::default() };
    Counter::like(&Gpu::open(&options).expect("a GPU or a software Vulkan")).expect("a device")
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn what_builds_do() {
    let counter = counter();
    let mut out = String::new();
    for (name, preset) in
        [("builtin:city:4000", Preset::Fast), ("builtin:city:2000", Preset::Balanced)]
    {
        let scene = Scene::open(name).expect("a scene");
        let mesh = scene.mesh().expect("a mesh");
        let counted = count(&counter, &mesh, preset).expect("a build");
        let (triangles, preset) = (counted.triangles, preset.name());
        out += &format!("{name}, {triangles} triangles, {preset}\n\n{}\n", table(&counted));
    }
    insta::assert_snapshot!(out);
}
