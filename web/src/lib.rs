//! What the JavaScript of the package calls: numbers in and out through arrays in the module's memory, errors as exceptions with a
//! code. Users see the classes in `js/`, which check types and lengths, and give options names.

// The page on threads is neither of the package's parts nor has it WebGPU.
#![cfg_attr(
    all(feature = "page", not(feature = "gpu")),
    expect(dead_code, reason = "what the package's queries share with the part for WebGPU")
)]

mod crossings;
#[cfg(any(feature = "gpu", not(feature = "page")))]
mod edits;
mod failure;
#[cfg(feature = "gpu")]
mod gpu;
#[cfg(feature = "gpu")]
mod gpu_scene;
mod mesh;
mod named;
#[cfg(feature = "page")]
mod page;
mod progress;
// The module for WebGPU is loaded beside the one that has these, and the page has objects of its own.
#[cfg(not(any(feature = "gpu", feature = "page")))]
mod scene;
#[cfg(feature = "threads")]
pub mod threads;
#[cfg(not(any(feature = "gpu", feature = "page")))]
mod tree;
mod words;

use wasm_bindgen::prelude::*;

/// A panic becomes a line of the console; without this it is only `unreachable executed`.
#[wasm_bindgen(start)]
fn start() {
    std::panic::set_hook(Box::new(|panic| {
        console_error(&panic.to_string());
        #[cfg(feature = "gpu")]
        gpu::crashed(&panic.to_string());
    }));
}

#[wasm_bindgen]
extern "C" {
    #[wasm_bindgen(js_namespace = console, js_name = error)]
    fn console_error(text: &str);
}

/// The version of the package.
#[wasm_bindgen]
pub fn version() -> String {
    env!("CARGO_PKG_VERSION").to_owned()
}

/// Has this function called, with a text, when the module ends by a panic: promises of work under way are never settled then.
#[cfg(feature = "gpu")]
#[wasm_bindgen(js_name = afterCrash)]
pub fn after_crash(called: js_sys::Function) {
    gpu::after_crash(called);
}

/// The instruction set of queries.
#[wasm_bindgen(js_name = instructionSet)]
pub fn instruction_set() -> String {
    splitplane::InstructionSet::detect().name().to_owned()
}
