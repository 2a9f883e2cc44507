//! What a browser has in place of threads and sleep: promises and timers.

use std::time::Duration;

use js_sys::{Function, Promise, Reflect};
use wasm_bindgen::{JsCast, JsValue};
use wasm_bindgen_futures::JsFuture;

use super::patience::Patience;

/// Between two looks at a device by work that nothing wakes. A browser makes it longer, a second and more in the background.
const TICK: i32 = 4;

/// A property of an object, if there is one that is neither `undefined` nor `null`.
fn property(of: &JsValue, name: &str) -> Option<JsValue> {
    let value = Reflect::get(of, &name.into()).ok()?;
    (!value.is_undefined() && !value.is_null()).then_some(value)
}

/// Resolves after some milliseconds, or at once where there are no timers.
async fn timer(milliseconds: i32) {
    let global: JsValue = js_sys::global().into();
    let promise = Promise::new(&mut |resolve, _| {
        let set = property(&global, "setTimeout").and_then(|set| set.dyn_into::<Function>().ok());
        let begun = set.and_then(|set| set.call2(&global, &resolve, &milliseconds.into()).ok());
        if begun.is_none() {
            // Fails for functions that throw, and this one does not.
            let _ = resolve.call0(&JsValue::NULL);
        }
    });
    let _ = JsFuture::from(promise).await;
}

/// Resolves at the next tick.
pub(crate) async fn tick() {
    timer(TICK).await;
}

/// Lets what the browser has to tell come first, without a timer.
pub(crate) async fn turn() {
    let _ = JsFuture::from(Promise::resolve(&JsValue::UNDEFINED)).await;
}

/// The outcome of work of the browser's, or `None` when it takes longer than the limit.
pub(crate) async fn within<T>(limit: Duration, work: impl Future<Output = T>) -> Option<T> {
    let mut work = std::pin::pin!(work);
    let mut patience = Patience::new(limit);
    loop {
        let mut tick = std::pin::pin!(timer(20));
        let look = std::future::poll_fn(|context| {
            if let std::task::Poll::Ready(out) = work.as_mut().poll(context) {
                return std::task::Poll::Ready(Some(out));
            }
            tick.as_mut().poll(context).map(|()| None)
        });
        match look.await {
            Some(out) => return Some(out),
            None if patience.is_over() => return None,
            None => {}
        }
    }
}

/// What the browser says about the adapter that it gives: wgpu passes on one of four texts, which most browsers leave empty.
pub(crate) async fn adapter_name() -> Option<String> {
    let navigator = property(&js_sys::global().into(), "navigator")?;
    let gpu = property(&navigator, "gpu")?;
    let request: Function = property(&gpu, "requestAdapter")?.dyn_into().ok()?;
    let promise: Promise = request.call0(&gpu).ok()?.dyn_into().ok()?;
    let adapter = JsFuture::from(promise).await.ok()?;
    let info = property(&adapter, "info")?;
    let mut parts: Vec<String> = Vec::new();
    for name in ["description", "vendor", "architecture", "device"] {
        let part = property(&info, name).and_then(|part| part.as_string()).unwrap_or_default();
        let part = part.trim();
        // A description often names the vendor.
        let is_known =
            parts.iter().any(|known| known.to_lowercase().contains(&part.to_lowercase()));
        if !part.is_empty() && !is_known {
            parts.push(part.to_owned());
        }
    }
    (!parts.is_empty()).then(|| parts.join(" "))
}
