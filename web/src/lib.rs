//! What the JavaScript of the package calls: numbers in and out through arrays in the module's memory, errors as exceptions with a
//! code. Users see the classes in `js/`, which check types and lengths, and give options names.

mod failure;
mod named;
#[cfg(feature = "page")]
mod page;
mod progress;
mod scene;
mod tree;
mod words;

use wasm_bindgen::prelude::*;

/// A panic becomes a line of the console; without this it is only `unreachable executed`.
#[wasm_bindgen(start)]
fn start() {
    std::panic::set_hook(Box::new(|panic| console_error(&panic.to_string())));
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

/// The instruction set of queries.
#[wasm_bindgen(js_name = instructionSet)]
pub fn instruction_set() -> String {
    splitplane::InstructionSet::detect().name().to_owned()
}
