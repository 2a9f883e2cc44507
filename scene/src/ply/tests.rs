use super::*;
use crate::mesh_file::Place;
use std::path::PathBuf;

fn path() -> PathBuf {
    PathBuf::from("some.ply")
}

/// Names of types, each kind of number once.
const TYPES: [&str; 8] = ["char", "uint8", "short", "uint16", "int", "uint32", "float", "float64"];

fn read(bytes: &[u8]) -> Result<Scene, MeshFileError> {
    parse(bytes, &path())
}

fn message(bytes: &[u8]) -> String {
    read(bytes).expect_err("a bad file").to_string()
}

/// A square of every kind of number among others that nobody asked for, in one of the three forms.
fn square(form: usize, types: [&str; 3], count: &str) -> Vec<u8> {
    let name = ["ascii", "binary_little_endian", "binary_big_endian"][form];
    let [x, list, extra] = types;
    let mut bytes = format!(
        "ply\nformat {name} 1.0\ncomment \u{e9}t\u{e9}\nobj_info 1 2\nelement face 2\nproperty {extra} flags\n\
         property list {count} {list} vertex_indices\nproperty list uchar {extra} weights\n\
         element material 1\nproperty list {count} {extra} parts\nproperty {x} last\n\
         element vertex 4\nproperty {x} z\nproperty {extra} intensity\nproperty {x} x\nproperty {x} y\nend_header\n"
    )
    .into_bytes();
    let mut numbers = |row: &[(&str, f64)]| {
        for (kind, value) in row {
            let le = match *kind {
                _ if form == 0 => format!("{value} ").into_bytes(),
                "char" => (*value as i8).to_le_bytes().to_vec(),
                "uint8" | "uchar" => (*value as u8).to_le_bytes().to_vec(),
                "short" => (*value as i16).to_le_bytes().to_vec(),
                "uint16" => (*value as u16).to_le_bytes().to_vec(),
                "int" => (*value as i32).to_le_bytes().to_vec(),
                "uint32" => (*value as u32).to_le_bytes().to_vec(),
                "float" => (*value as f32).to_le_bytes().to_vec(),
                _ => value.to_le_bytes().to_vec(),
            };
            match form {
                2 => bytes.extend(le.iter().rev()),
                _ => bytes.extend(le),
            }
        }
        if form == 0 {
            bytes.push(b'\n');
        }
    };
    let face = |corners: &[f64]| -> Vec<(&str, f64)> {
        let mut row = vec![(extra, 1.0), (count, corners.len() as f64)];
        row.extend(corners.iter().map(|corner| (list, *corner)));
        row.extend([("uchar", 2.0), (extra, 5.0), (extra, 6.0)]);
        row
    };
    numbers(&face(&[0.0, 1.0, 2.0, 3.0]));
    numbers(&face(&[3.0, 1.0, 0.0]));
    numbers(&[(count, 1.0), (extra, 9.0), (x, 8.0)]);
    for [a, b] in [[0.0, 0.0], [7.0, 0.0], [7.0, 5.0], [0.0, 5.0]] {
        numbers(&[(x, 2.0), (extra, 3.0), (x, a), (x, b)]);
    }
    bytes
}

#[test]
fn every_type_in_every_form_among_what_nobody_asked_for() {
    let mut read_in = 0;
    for form in 0..3 {
        for x in TYPES {
            for list in TYPES {
                for count in ["uint8", "char", "short", "uint16", "int", "uint32"] {
                    let bytes = square(form, [x, list, "short"], count);
                    let scene = read(&bytes).unwrap_or_else(|error| panic!("{x} {list}: {error}"));
                    let want = [[0.0, 0.0, 2.0], [7.0, 0.0, 2.0], [7.0, 5.0, 2.0], [0.0, 5.0, 2.0]];
                    assert_eq!(scene.positions, want, "{x}, {list}");
                    assert_eq!(scene.indices, [[0, 1, 2], [0, 2, 3], [3, 1, 0]]);
                    assert_eq!(scene.material_of, [0; 3]);
                    assert_eq!(scene.notes.sentences(), ["1 elements `material` are skipped"]);
                    assert_eq!(parse_points(&bytes, &path()).unwrap(), want);
                    read_in += 1;
                }
            }
        }
    }
    assert_eq!(read_in, 3 * 8 * 8 * 6);
}

const CLOUD: &str = "ply\r\nformat ascii 1.0\r\nelement vertex 3\r\nproperty float x\r\nproperty double y\r\n\
                     property float z\r\nproperty uchar red\r\nend_header\r\n1 .5 nan 3\r\n\r\n-0 5. 1e-45\r\n7\r\n0.1 0.1 inf 9";

#[test]
fn a_cloud_gives_its_points_and_is_no_mesh() {
    let more = CLOUD.replace("nan 3", "nan 3 4");
    let more = parse_points(more.as_bytes(), &path()).expect_err("five numbers").to_string();
    assert!(more.contains("line 9: ") && more.contains("more numbers"), "{more}");
    // An element may go on in the next line, as its last number does in line 12.
    let points = parse_points(CLOUD.as_bytes(), &path()).unwrap();
    let bits: Vec<u32> = points.as_flattened().iter().map(|x| x.to_bits()).collect();
    let want = [1.0, 0.5, f32::NAN, -0.0, 5.0, 1e-45, 0.1, 0.1, f32::INFINITY];
    assert_eq!(bits, want.map(f32::to_bits));
    assert_eq!(read(CLOUD.as_bytes()).unwrap_err().problem, MeshFileProblem::NoTriangles);
    let none = parse_points(b"ply\nformat ascii 1.0\nend_header\n", &path()).unwrap_err();
    assert_eq!(none.problem, MeshFileProblem::NoPoints);
    for encoding in [Encoding::Ascii, Encoding::LittleEndian, Encoding::BigEndian] {
        let again = parse_points(&points_to_bytes(&points, encoding).unwrap(), &path()).unwrap();
        let again: Vec<u32> = again.as_flattened().iter().map(|x| x.to_bits()).collect();
        assert_eq!(again, want.map(f32::to_bits), "{encoding:?}");
    }
}

#[test]
fn strips_and_normals_and_what_is_written() {
    let text = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n\
                property float nx\nproperty float ny\nproperty float nz\nelement tristrips 1\n\
                property list int int vertex_indices\nend_header\n0 0 0 0 0 2\n1 0 0 0 3 0\n0 1 0 0 0 0\n1 1 0 1 0 0\n\
                2 2 2 0 0 nan\n8 0 1 2 3 -1 4 3 2\n";
    let scene = read(text.as_bytes()).unwrap();
    assert_eq!(scene.indices, [[0, 1, 2], [2, 1, 3], [4, 3, 2]]);
    assert_eq!(scene.normals[..2], [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]);
    let none = Scene::NONE;
    assert_eq!(scene.normal_indices, [[0, 1, none], [none, 1, 3], [none, 3, none]]);
    assert_eq!(scene.notes.unusable_normals, 2);
    let mut whole = scene.clone();
    whole.normals = vec![[0.0, 0.6, 0.8]; 5];
    whole.normal_indices = whole.indices.clone();
    for encoding in [Encoding::Ascii, Encoding::LittleEndian, Encoding::BigEndian] {
        for scene in [&scene, &whole] {
            let again = read(&to_bytes(scene, encoding).unwrap()).unwrap();
            assert_eq!((&again.positions, &again.indices), (&scene.positions, &scene.indices));
        }
        let again = read(&to_bytes(&whole, encoding).unwrap()).unwrap();
        assert_eq!(again.normals, whole.normals);
        assert_eq!(again.normal_indices, whole.normal_indices);
    }
}

#[test]
fn errors_name_the_line_or_the_byte() {
    let good = String::from_utf8(square(0, ["float", "int", "short"], "uint8")).unwrap();
    let cases = [
        ("ply\n", "plx\n", "line 1: ", "begins with"),
        ("ascii 1.0", "ascii 2.0", "line 2: ", "other versions"),
        ("format ascii", "format utf8", "line 2: ", "`utf8`"),
        ("element face 2", "element face -2", "line 5: ", "`-2`"),
        ("element face 2", "element face 4294967295", "line 5: ", "4294967295 elements `face`"),
        ("element vertex 4", "element vertex 18446744073709551615", "line 12: ", "room for"),
        ("property short flags", "property long flags", "line 6: ", "`long`"),
        ("list uint8", "list float", "line 7: ", "whole number"),
        ("vertex_indices", "indices", "line 5: ", "needs one list"),
        ("float y", "float x", "line 12: ", "one property `x`, this one has 2"),
        ("end_header", "end", "line 17: ", "`end`"),
        ("element material", "element face", "line 9: ", "another element"),
        ("1 4 0 1 2 3", "1 4294967295 0 1 2 3", "line 18: ", "numbers in a list"),
        ("1 4 0 1 2 3", "1 -4 0 1 2 3", "line 18: ", "a list of -4"),
        ("1 4 0 1 2 3", "1 4 0 1 2 4", "line 18: ", "vertex 4 is named, but there are 4"),
        ("1 4 0 1 2 3", "1 4 0 1 2 -1", "line 18: ", "vertex -1"),
        ("1 4 0 1 2 3", "1 4 0 1 2 2.5", "line 18: ", "2.5 is no index"),
        ("1 4 0 1 2 3", "1 4 0 1 2 nan", "line 18: ", "NaN is no index"),
        ("2 3 7 5", "2 3 7 five", "line 23: ", "`five`"),
        ("2 3 7 5", "2 3 7 5 5", "line 23: ", "more numbers"),
        ("2 3 0 5", "2 3 0", "line 25: ", "ends within a property `y`"),
        ("comment", "comments", "line 3: ", "`comments`"),
    ];
    for (from, to, place, words) in cases {
        let text = good.replacen(from, to, 1);
        assert_ne!(text, good, "{from}");
        let error = message(text.as_bytes());
        assert!(error.contains(place) && error.contains(words), "{to}: {error}");
    }
    let bytes = square(1, ["float", "int", "short"], "uint8");
    let cut = read(&bytes[..bytes.len() - 1]).unwrap_err();
    assert_eq!(cut.place, Some(Place::Byte(bytes.len() as u64 - 4)));
}

/// Files cut off at every byte, and with every byte another: a scene or an error of one line, in memory that the file's length bounds.
#[test]
fn no_bytes_do_anything_but_be_read_or_refused() {
    let mut refused = 0;
    let mut check = |bytes: &[u8]| match read(bytes) {
        Ok(scene) => {
            assert!(scene.mesh().is_ok());
            assert!(scene.positions.capacity() <= 4 * bytes.len());
            assert!(scene.indices.capacity() <= 4 * bytes.len());
        }
        Err(error) => {
            let error = error.to_string();
            assert!(!error.contains('\n') && error.len() < 1000, "{error}");
            refused += 1;
        }
    };
    for form in 0..3 {
        let good = square(form, ["float", "uint16", "char"], "int");
        for at in 0..good.len() {
            check(&good[..at]);
            for other in [0, 0xff, 0x7f, b'\n', b'9', b'-', b' '] {
                let mut bytes = good.clone();
                bytes[at] = other;
                check(&bytes);
            }
        }
        // Every word of four bytes as the greatest count.
        for at in 0..good.len() - 4 {
            let mut bytes = good.clone();
            bytes[at..at + 4].fill(0xff);
            check(&bytes);
        }
    }
    check(&b"ply\n".repeat(1 << 20));
    check(&[b"ply\nformat ascii 1.0\n".to_vec(), b"property\n".repeat(9999)].concat());
    let many = "element e0 1\nproperty int a\n".to_owned() + &"property int a\n".repeat(1 << 13);
    check(format!("ply\nformat ascii 1.0\n{many}end_header\n").as_bytes());
    assert!(refused > 5000, "{refused}");
}
