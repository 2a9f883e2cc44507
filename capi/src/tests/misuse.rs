//! What only Rust can plant: panics, and handles whose place was used again. Other misuses are those of `tests/misuse.c`.

use std::ffi::CStr;

use library::Stage;

use crate::entry::{entry, splitplane_last_message};
use crate::handle::{Lists, Tree, free, get, insert};
use crate::lists::Object;
use crate::progress::stage_name;
use crate::status::{Failure, Status};

fn message() -> String {
    // SAFETY: the text is there until the next call of this thread fails.
    unsafe { CStr::from_ptr(splitplane_last_message()) }.to_str().unwrap().to_owned()
}

#[test]
fn panics_end_at_the_border() {
    assert_eq!(entry(|| panic!("planted {}", 7)), Status::Internal);
    assert_eq!(message(), "a fault: planted 7");
    assert_eq!(entry(|| std::panic::panic_any(7)), Status::Internal);
    assert_eq!(message(), "a fault: it says nothing");
    // A panic of a thread that works for the call.
    let deep = || {
        let (ok, ()) = rayon::join(|| Ok::<(), Failure>(()), || panic!("deep"));
        ok
    };
    assert_eq!(entry(deep), Status::Internal);
    assert_eq!(entry(|| Ok(())), Status::Ok);
    assert_eq!(message(), "a fault: deep");
}

#[test]
fn messages_belong_to_their_threads() {
    let fail = |text: &'static str| entry(|| Err(Failure::new(Status::Option, text)));
    assert_eq!(fail("one\0two"), Status::Option);
    std::thread::spawn(move || {
        assert_eq!(message(), "");
        assert_eq!(fail("other"), Status::Option);
        assert_eq!(message(), "other");
    })
    .join()
    .unwrap();
    assert_eq!(message(), "one two");
}

#[test]
fn a_handle_does_not_come_back() {
    let object = || Object::Points { starts: vec![0], found: Vec::new() };
    let mut given = Vec::new();
    for _ in 0..1000 {
        let handle: Lists = insert(object()).unwrap();
        assert!(!given.contains(&handle.id));
        given.push(handle.id);
        assert_eq!(get(Tree { id: handle.id }).err().unwrap().status, Status::Handle);
        assert_eq!(free(Tree { id: handle.id }).unwrap_err().status, Status::Handle);
        let kept = get(handle).ok().unwrap();
        free(handle).unwrap();
        assert!(matches!(&*kept, Object::Points { .. }), "whoever holds it keeps it");
        assert_eq!(free(handle).unwrap_err().status, Status::Handle);
    }
    assert_eq!(free(Lists { id: u64::MAX }).unwrap_err().status, Status::Handle);
    free(Lists { id: 0 }).unwrap();
}

#[test]
fn stages_have_the_library_s_names() {
    for stage in [
        Stage::Start,
        Stage::LargeNodes,
        Stage::SmallNodes,
        Stage::Output,
        Stage::Offline,
        Stage::Layout,
        Stage::Device,
        Stage::Rays,
        Stage::Geometries,
        Stage::Points,
    ] {
        assert_eq!(stage_name(stage).to_str(), Ok(stage.name()));
    }
}
