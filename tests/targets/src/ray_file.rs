//! Files of rays: raw or .npy, of any bytes or with a header of known meaning.

use crate::source::Source;
use splitplane_cli::{npy, ray_file};
use std::path::Path;

/// Bytes as a file of rays. Where they have a meaning by construction, that is what must come out.
pub fn run(data: &[u8]) {
    let mut source = Source::new(data);
    let named_npy = source.once_in(2);
    match source.below(4) {
        0 => raw(source.rest(), named_npy),
        1 => headed(&mut source),
        2 => round_trip(&mut source),
        _ => altered(&mut source),
    }
}

fn path(npy: bool) -> &'static Path {
    Path::new(if npy { "some.npy" } else { "some.rays" })
}

/// Any bytes: rays and bytes must agree in number and value.
fn raw(bytes: &[u8], named_npy: bool) {
    match ray_file::parse(path(named_npy), bytes) {
        Ok(rays) => {
            if named_npy || npy::is_npy(bytes) {
                // f64 of the same rays would be twice as many.
                assert!(rays.len() * 32 <= bytes.len());
                return;
            }
            assert_eq!(rays.len() * 32, bytes.len());
            for (ray, words) in rays.iter().zip(bytes.chunks(32)) {
                let [ox, oy, oz] = ray.origin;
                let [dx, dy, dz] = ray.direction;
                let again = [ox, oy, oz, dx, dy, dz, ray.t_min, ray.t_max];
                let again: Vec<u8> = again.iter().flat_map(|x| x.to_bits().to_le_bytes()).collect();
                assert_eq!(again, words);
            }
        }
        Err(failure) => {
            crate::check_message(
                failure.message(),
                if named_npy { "some.npy" } else { "some.rays" },
            );
            let whole = bytes.len().is_multiple_of(32) && !named_npy && !npy::is_npy(bytes);
            assert!(!whole, "whole rays are refused: {}", failure.message());
        }
    }
}

/// A header from parts that may be wrong; what each part says is known.
fn headed(source: &mut Source<'_>) {
    let (kind, size) = source.pick(&[
        ("'<f4'", 4),
        ("'<f8'", 8),
        ("\"<f4\"", 4),
        ("'>f4'", 0),
        ("'<i4'", 0),
        ("[('x', '<f4')]", 0),
        ("", 0),
    ]);
    let order = source.pick(&["False", "True", "false", ""]);
    let count = source.pick(&[
        "0",
        "1",
        "2",
        "18446744073709551615",
        "576460752303423488",
        "-1",
        "1e3",
        "",
    ]);
    let width = source.pick(&[", 8", ",8", ", 8,", ", 9", "", ", 8, 1"]);
    let keys = source.pick(&[
        ["descr", "fortran_order", "shape"],
        ["shape", "descr", "fortran_order"],
        ["descr", "x", "shape"],
    ]);
    let value = |key: &str| match key {
        "descr" => kind.to_owned(),
        "fortran_order" => order.to_owned(),
        "shape" => format!("({count}{width})"),
        _ => "0".to_owned(),
    };
    let fields: Vec<String> = keys.iter().map(|key| format!("'{key}': {}", value(key))).collect();
    let header = format!("{{{}, }}\n", fields.join(", "));
    let version = source.pick(&[1u8, 2, 3, 0, 4, 255]);
    let length = source.pick(&[0i64, 0, 0, 1, -1, 70_000]);
    let said = (header.len() as i64 + length).max(0) as u32;
    let mut bytes = b"\x93NUMPY".to_vec();
    bytes.extend([version, source.below(256) as u8]);
    match version {
        1 => bytes.extend((said as u16).to_le_bytes()),
        _ => bytes.extend(said.to_le_bytes()),
    }
    bytes.extend(header.bytes());
    let promised =
        count.parse::<u64>().ok().filter(|count| *count < 3).unwrap_or(1) as usize * 8 * size;
    let missing = source.pick(&[0usize, 0, 0, 1, 7]);
    let numbers: Vec<u8> = (0..promised).map(|i| (i * 7) as u8).collect();
    let whole = missing == 0 || numbers.is_empty();
    bytes.extend(&numbers[..numbers.len().saturating_sub(missing)]);
    let good = size > 0
        && order == "False"
        && matches!(count, "0" | "1" | "2")
        && matches!(width, ", 8" | ",8" | ", 8,")
        && !keys.contains(&"x")
        && matches!(version, 1..=3)
        && length == 0
        && whole;
    match ray_file::parse(path(true), &bytes) {
        // A length that is wrong by one may fall on the line feed at the end.
        Ok(rays) => {
            assert!(good || length.abs() == 1, "{header}: {} rays", rays.len());
            assert_eq!(Ok(rays.len()), count.parse());
        }
        Err(failure) => {
            assert!(!good, "{header} is refused: {}", failure.message());
            crate::check_message(failure.message(), "some.npy");
        }
    }
}

/// What the program writes has a header that its reader understands.
fn round_trip(source: &mut Source<'_>) {
    let rows = source.below(9);
    let mut bytes = npy::header("'<f4'", rows);
    assert_eq!(bytes.len() % 64, 0);
    // Hits are a list of numbers, rays a table of eight columns.
    let text = String::from_utf8_lossy(&bytes).into_owned();
    let Some(at) = text.find(&format!("({rows},)")) else { panic!("no shape in {text}") };
    let shape = format!("({rows},8)");
    // The blanks that pad the header make room.
    let (offset, old) = (bytes.len() - text[at..].len(), format!("({rows},), }}"));
    let new = format!("{shape}, }}");
    let at = bytes.windows(old.len()).position(|window| window == old.as_bytes()).unwrap_or(offset);
    bytes.splice(at..at + old.len() + 1, new.bytes());
    let numbers: Vec<f32> = (0..rows * 8).map(|_| source.number()).collect();
    bytes.extend(numbers.iter().flat_map(|x| x.to_bits().to_le_bytes()));
    let rays = ray_file::parse(path(false), &bytes).expect("our own header");
    assert_eq!(rays.len(), rows);
    for (ray, row) in rays.iter().zip(numbers.chunks(8)) {
        assert_eq!(ray.t_max.to_bits(), row[7].to_bits());
        assert_eq!(ray.t_min.to_bits(), row[6].to_bits());
    }
}

/// A good file with bytes changed, put in or taken out.
fn altered(source: &mut Source<'_>) {
    let mut bytes = b"\x93NUMPY\x01\x00\x46\x00{'descr': '<f4', 'fortran_order': False, 'shape': (1, 8), }           \n"
        .to_vec();
    bytes.extend([0u8; 32]);
    for _ in 0..1 + source.below(6) {
        if bytes.is_empty() {
            break;
        }
        let at = source.below(bytes.len());
        match source.below(4) {
            0 => bytes[at] = source.below(256) as u8,
            1 => bytes.insert(at, source.below(256) as u8),
            2 => drop(bytes.remove(at)),
            _ => bytes.truncate(at),
        }
    }
    raw(&bytes, source.once_in(2));
}
