use super::*;

fn read(bytes: &[u8]) -> Result<Scene, MeshFileError> {
    parse(bytes, Path::new("some.stl"))
}

const TEXT: &str = "\n SOLID two of them\r\nfacet normal 0 0 1\r\n outer loop\r\n  vertex 0 0 0\r\n  vertex 1 0 0\r\n  vertex 1 1 0\r\n endloop\r\n\
                    endfacet\r\nfacet normal -nan(ind) x x outer loop vertex 1 1 0 vertex -0 0 0 vertex 1 1e-45 nan endloop endfacet\r\n\
                    endsolid two\r\nsolid\r\nendsolid\r\nsolid b\nFacet Normal 0 0 1 Outer Loop\nvertex 2 0 0\nvertex 1 0 0\nvertex 1 1 0\nEndLoop\nEndFacet\nendsolid\n";

fn binary_file(triangles: &[[[f32; 3]; 3]], header: &[u8]) -> Vec<u8> {
    let mut bytes = header.to_vec();
    bytes.resize(80, b' ');
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for corners in triangles {
        bytes.extend([0; 12]);
        corners.as_flattened().iter().for_each(|x| bytes.extend(x.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

fn corners(scene: &Scene) -> Vec<[[u32; 3]; 3]> {
    scene.triangles().map(|corners| corners.map(|corner| corner.map(f32::to_bits))).collect()
}

#[test]
fn text_and_bytes_give_the_same_triangles() {
    let text = read(TEXT.as_bytes()).unwrap();
    assert_eq!(text.indices, [[0, 1, 2], [2, 3, 4], [5, 1, 2]]);
    assert_eq!(text.positions.len(), 6);
    assert_eq!(
        text.notes.sentences(),
        ["1 vertices are not finite; their triangles cannot be hit"]
    );
    assert_eq!(text.triangles_of(true, "two of them").first(), Some(&(0..2)));
    assert_eq!(text.triangles_of(true, "b").first(), Some(&(2..3)));
    let triangles: Vec<[[f32; 3]; 3]> = text.triangles().collect();
    for header in [&b"made by hand"[..], b"solid of bytes", b"solid"] {
        let bytes = binary_file(&triangles, header);
        let read = read(&bytes).unwrap();
        assert_eq!(corners(&read), corners(&text));
        assert_eq!(read.indices, text.indices);
    }
    for header in [&b"x"[..], b"solid x"] {
        let mut odd = binary_file(&triangles, header);
        odd[84 + 48] = 7;
        odd.push(0);
        let notes = read(&odd).unwrap().notes.warnings;
        assert!(notes[0].starts_with("the attributes of 1 ") && notes[1].starts_with("1 bytes "));
    }
}

#[test]
fn errors_name_the_line_or_the_byte() {
    let cases = [
        ("vertex 1 0 0", "vertex 1 0 y", "line 6: ", "`y` is not a number"),
        ("vertex 1 0 0\r", "vertex 1 0\r", "line 7: ", "`vertex` is not a number"),
        (
            "endloop",
            "vertex 1 2 3 endloop",
            "line 8: ",
            "`endloop` should stand here, not `vertex`",
        ),
        ("\nfacet", "\nfacets", "line 3: ", "`facet` or `endsolid`"),
        ("endsolid\r", "end\r", "line 13: ", "`facet` or `endsolid` should stand here, not `end`"),
        ("EndFacet\nendsolid\n", "", "line 20: ", "ends within a facet"),
    ];
    for (from, to, place, words) in cases {
        let text = TEXT.replacen(from, to, 1);
        assert_ne!(text, TEXT, "{from}");
        let error = read(text.as_bytes()).expect_err(to).to_string();
        assert!(error.contains(place) && error.contains(words), "{to}: {error}");
    }
    let open = read(&TEXT.as_bytes()[..TEXT.len() - 10]).unwrap().notes.warnings;
    assert!(open[0].contains("`endsolid`"), "{open:?}");
    let mut bytes = binary_file(&[[[0.0; 3]; 3]; 2], b"");
    for count in [3u32, u32::MAX] {
        bytes[80..84].copy_from_slice(&count.to_le_bytes());
        let error = read(&bytes).unwrap_err();
        assert_eq!(error.place, Some(Place::Byte(80)));
        assert!(error.to_string().contains(&format!("{count} triangles")), "{error}");
    }
    assert_eq!(read(b"solid\nendsolid").unwrap_err().problem, MeshFileProblem::NoTriangles);
    for none in [&b""[..], b"solids", &[0; 83]] {
        assert!(read(none).unwrap_err().to_string().contains("neither"), "{none:?}");
    }
}

#[test]
fn no_bytes_do_anything_but_be_read_or_refused() {
    let mut refused = 0;
    let mut check = |bytes: &[u8]| match read(bytes) {
        Ok(scene) => {
            assert!(scene.mesh().is_ok());
            assert!(scene.indices.capacity() * 12 <= 4 * bytes.len() + 64);
        }
        Err(error) => {
            let error = error.to_string();
            assert!(!error.contains('\n') && error.len() < 1000, "{error}");
            refused += 1;
        }
    };
    let binary = binary_file(&[[[1.0, 2.0, 3.0]; 3]; 3], b"solid");
    for good in [TEXT.as_bytes(), &binary] {
        for at in 0..good.len() {
            check(&good[..at]);
            for other in [0, 0xff, b'\n', b'9', b' '] {
                let mut bytes = good.to_vec();
                bytes[at] = other;
                check(&bytes);
            }
            let mut bytes = good.to_vec();
            let end = good.len().min(at + 4);
            bytes[at..end].fill(0xff);
            check(&bytes);
        }
    }
    check(&b"solid\n".repeat(1 << 18));
    assert!(refused > 800, "{refused}");
}
