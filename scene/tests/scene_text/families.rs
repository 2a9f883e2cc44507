//! Texts of scene files that grow in one way each.

use std::fmt::Write;
use std::fs;
use std::path::Path;

/// A kind of text.
pub(crate) struct Family {
    /// What grows.
    pub(crate) name: &'static str,
    /// The text.
    pub(crate) text: String,
    /// Whether it is a scene.
    pub(crate) is_scene: bool,
}

/// How many entries there are.
const MANY: usize = 6_000;
/// Files of which each is worth many warnings.
const SAID: usize = 60;
/// Entries of a list that are small.
const MORE: usize = 40_000;
const TRIANGLE: &str =
    r#"{"name":"g","positions":[[0,0,0],[1,0,0],[0,1,0]],"triangles":[[0,1,2]]}"#;
const INSTANCE: &str = r#"{"geometry":"g"}"#;

fn family(name: &'static str, text: String) -> Family {
    Family { name, text, is_scene: true }
}

/// So many entries with their numbers.
fn list(count: usize, entry: impl Fn(usize) -> String) -> String {
    let mut text = String::new();
    for number in 0..count {
        let comma = if number == 0 { "" } else { ",\n" };
        write!(text, "{comma}{}", entry(number)).unwrap();
    }
    text
}

/// A file of these geometries, instances, and further fields.
fn file(geometries: &str, instances: &str, more: &str) -> String {
    format!(
        "{{\"format\":\"splitplane-scene\",\"version\":1,\"frames\":1000000{more},\n\"geometries\":[\n{geometries}\n],\n\"instances\":[\n{instances}\n]}}"
    )
}

/// .obj files that texts name.
pub(crate) fn files(folder: &Path) {
    let grid = |side: usize| {
        let mut text = String::new();
        for vertex in 0..side * side {
            writeln!(text, "v {} {} 0\nvn 0 0 1\nvt {} 0", vertex % side, vertex / side, vertex)
                .unwrap();
        }
        for cell in 0..side * (side - 1) - 1 {
            let corner = |at: usize| format!("{0}/{0}/{0}", at + 1);
            let corners = [cell, cell + 1, cell + side].map(corner);
            if cell % 50 == 0 {
                writeln!(text, "g part{cell} all\nusemtl m{cell}").unwrap();
            }
            writeln!(text, "f {}", corners.join(" ")).unwrap();
        }
        text
    };
    fs::write(folder.join("first.obj"), grid(3)).unwrap();
    fs::write(folder.join("second.obj"), grid(60)).unwrap();
    fs::write(folder.join("third.obj"), grid(40)).unwrap();
    fs::write(folder.join("wide.obj"), grid(110)).unwrap();
    // Leaves with holes as fine as masks can be.
    let picture = image::RgbaImage::from_fn(256, 256, |x, y| image::Rgba([9, 9, 9, (x ^ y) as u8]));
    picture.save(folder.join("leaf.png")).unwrap();
    fs::write(folder.join("leaf.mtl"), "newmtl leaf\nmap_d leaf.png\n").unwrap();
    let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n";
    let leaves =
        format!("mtllib leaf.mtl\nusemtl leaf\n{corners}{}", "f 1/1 2/2 3/3\n".repeat(300));
    fs::write(folder.join("leaves.obj"), leaves).unwrap();
    // Few lists of many vertices.
    let vertices: String = (0..60_000).map(|number| format!("v {number} 0 1\n")).collect();
    let face =
        |number: usize| format!("f {} {} {}\n", 3 * number + 1, 3 * number + 2, 3 * number + 3);
    let faces: String = (0..20_000).map(face).collect();
    fs::write(folder.join("large.obj"), vertices + &faces).unwrap();
    // Materials that a library has, and others that none has.
    let used = |number: usize| format!("usemtl a{number}\nf 1 2 3\nusemtl b{number}\nf 1 2 3\n");
    let painted: String = (0..MANY / 2).map(used).collect();
    fs::write(folder.join("unpainted.obj"), format!("{corners}{painted}")).unwrap();
    fs::write(folder.join("painted.obj"), format!("mtllib many.mtl\n{corners}{painted}")).unwrap();
    let entry = |number: usize| format!("newmtl a{number}\nKd 1 0 0\nillum 4\nd 0.5\n");
    let entries: String = (0..MANY / 2).map(entry).collect();
    fs::write(folder.join("many.mtl"), entries).unwrap();
    // Files that there is much to say about: textures with options, of materials with long names, in several libraries.
    let libraries: Vec<String> = (0..6).map(|library| format!("said{library}.mtl")).collect();
    for library in &libraries {
        let option =
            |number: usize| format!("newmtl {}{number}\nmap_Kd -s 2 2 leaf.png\n", "y".repeat(150));
        fs::write(folder.join(library), (0..18).map(option).collect::<String>()).unwrap();
    }
    for number in 0..SAID {
        let text = format!("mtllib {}\n{corners}f 1 2 3\n", libraries.join(" "));
        fs::write(folder.join(format!("said{number}.obj")), text).unwrap();
    }
    // One line, joined from very many.
    fs::write(folder.join("joined.obj"), format!("{corners}f 1{} 2 3\n", " \\\n".repeat(100_000)))
        .unwrap();
    let groups = list(MANY, |number| format!("g a{number} b{} c\nf 1 2 3", number % 7));
    fs::write(
        folder.join("groups.obj"),
        format!("v 0 0 0\nv 1 0 0\nv 0 1 0\n{}", groups.replace(',', "")),
    )
    .unwrap();
}

/// A geometry of many spheres: most is held once all of them are read and copied.
fn spheres() -> String {
    format!(
        r#"{{"name":"g","spheres":[{}]}}"#,
        list(MORE, |number| format!(r#"{{"centre":[{number},0,0],"radius":1}}"#))
    )
}

/// Texts that are scenes.
pub(crate) fn good() -> Vec<Family> {
    let red = r#","materials":[{"name":"red","diffuse":[1,0,0]}]"#;
    let moved = |number: usize| {
        match number % 4 {
        0 => format!(
            r#"{{"geometry":"g","translate":[{number},0,0],"scale":2,"mask":{number},"id":7,"material":"red"}}"#
        ),
        1 => format!(
            r#"{{"geometry":"g","rotate":{{"axis":[0,1,0],"degrees":{number}}},"scale":[1,-2,0.5],"culling":"back"}}"#
        ),
        2 => format!(r#"{{"geometry":"g","transform":[1,0,0,{number},0,1,0,0,0,0,1,0.1]}}"#),
        _ => format!(r#"{{"geometry":"g","scale":1e-3,"rotate":null,"keys":[{{"frame":1}},{{"frame":{}}}]}}"#, number + 2)
            .replace("\"scale\":1e-3,", ""),
    }
    };
    let key = |number: usize| {
        format!(
            r#"{{"frame":{number},"translate":[0,{number},0],"rotate":{{"axis":[1,1,0],"degrees":{}}},"scale":[2,3,4]}}"#,
            number % 360
        )
    };
    let geometry = |number: usize| match number % 3 {
        0 => TRIANGLE.replace("\"g\"", &format!("\"g{number}\"")),
        1 => {
            format!(r#"{{"name":"g{number}","spheres":[{{"centre":[0,0,0],"radius":{number}}}]}}"#)
        }
        _ => format!(
            r#"{{"name":"g{number}","material":"red","capsules":[{{"ends":[[0,0,0],[0,1,0]],"radius":{number}}}]}}"#
        ),
    };
    let material = |number: usize| match number % 3 {
        0 => format!(r#"{{"name":"m{number}"}}"#),
        1 => {
            format!(r#"{{"name":"m{number}","mirror":[1,1,1],"roughness":0.5,"emission":[1,2,3]}}"#)
        }
        _ => format!(r#"{{"name":"m{number}","glass":{{"index":1.5,"tint":[1,0.5,1]}}}}"#),
    };
    let long = |number: usize| match number % 2 {
        0 => "x".repeat(30_000) + &number.to_string(),
        _ => "\\n\\u00e4".repeat(8_000) + &number.to_string(),
    };
    let named = |number: usize| TRIANGLE.replace("\"g\"", &format!("\"{}\"", long(number)));
    let arrays = format!(
        r#"{{"name":"g","positions":[{}],"triangles":[{}]}}"#,
        list(MORE, |number| format!("[{number},0.1,{}]", number % 7)),
        list(MORE, |number| format!("[{number},0,1]")),
    );
    let capsules = format!(
        r#"{{"name":"g","capsules":[{}]}}"#,
        list(MORE / 2, |number| format!(r#"{{"ends":[[{number},0,0],[0,0,1]],"radius":1}}"#))
    );
    let camera = |number: usize| format!(r#"{{"eye":[0,{number},9],"at":[0,0,0]}}"#);
    let light = |number: usize| match number % 2 {
        0 => r#"{"sun":{"towards":[0,1,0],"irradiance":[1,1,1]}}"#.to_owned(),
        _ => format!(
            r#"{{"point":{{"position":[0,{number},0],"irradiance":[1,1,1],"distance":2}}}}"#
        ),
    };
    let baked = |number: usize| {
        format!(r#"{{"geometry":"g","translate":[{number},0,0],"bake":"{}"}}"#, number / 3)
    };
    let parts = |number: usize| {
        let file = ["first", "second", "third", "first"][number % 4];
        let group = if number < 4 { String::new() } else { ",\"group\":\"part0\"".to_owned() };
        format!(r#"{{"name":"g{number}","obj":"{file}.obj"{group}}}"#)
    };
    let paths = |number: usize| {
        format!(r#"{{"name":"g{number}","obj":"{}first.obj"}}"#, "./".repeat(number % 100))
    };
    let said = |number: usize| match number {
        0 => r#"{"name":"g0","obj":"first.obj"}"#.to_owned(),
        _ => format!(r#"{{"name":"g{number}","obj":"said{}.obj"}}"#, number - 1),
    };
    let groups = |number: usize| match number {
        0 => r#"{"name":"g0","obj":"first.obj"}"#.to_owned(),
        _ => format!(r#"{{"name":"g{number}","obj":"groups.obj","group":"a{number}"}}"#),
    };
    let matrix = |number: usize| {
        format!(r#"{{"geometry":"g","transform":[1,0,0,{number},0,1,0,0,0,0,1,0]}}"#)
    };
    // Shorter than what an error's quote counts for.
    let name =
        |number: usize| "\\n".repeat(if number == 0 { 1 } else { 300 }) + &number.to_string();
    let called = |number: usize| TRIANGLE.replace("\"g\"", &format!("\"{}\"", name(number)));
    let many_names = format!(
        ",\"materials\":[{}]",
        list(MANY / 2, |number| format!(r#"{{"name":"{}"}}"#, name(number)))
    );
    let other = |file: &str| {
        format!(
            r#"{{"name":"g0","obj":"first.obj"}},{{"name":"g1","obj":"{file}.obj"}},{{"name":"g2","obj":"{file}.obj","material":"red"}}"#
        )
    };
    let baked_parts = |number: usize| {
        format!(
            r#"{{"geometry":"g{}","translate":[{number},0,0],"scale":[1,2,-1],"bake":"{}"}}"#,
            number % 3,
            number % 2
        )
    };
    let g0 = r#"{"geometry":"g0"}"#;
    let cameras = format!(",\"cameras\":[{}]", list(MANY, camera));
    let lights = format!(",\"lights\":[{}]", list(MANY, light));
    let materials = format!(",\"materials\":[{}]", list(MANY, material));
    vec![
        family("instances", file(TRIANGLE, &list(MORE, |_| INSTANCE.to_owned()), "")),
        family("moved instances", file(TRIANGLE, &list(MANY, moved), red)),
        family(
            "keys",
            file(TRIANGLE, &format!(r#"{{"geometry":"g","keys":[{}]}}"#, list(MORE / 4, key)), ""),
        ),
        family("transforms", file(TRIANGLE, &list(MORE / 2, matrix), "")),
        family("names", file(&list(MANY / 2, called), r#"{"geometry":"\n0"}"#, &many_names)),
        family("geometries", file(&list(MANY, geometry), g0, red)),
        family("materials", file(TRIANGLE, INSTANCE, &materials)),
        family("cameras", file(TRIANGLE, INSTANCE, &cameras)),
        family("lights", file(TRIANGLE, INSTANCE, &lights)),
        family(
            "long names",
            file(&list(20, named), &format!(r#"{{"geometry":"{}"}}"#, long(7)), ""),
        ),
        family("arrays", file(&arrays, INSTANCE, "")),
        family("spheres", file(&spheres(), INSTANCE, "")),
        family("capsules", file(&capsules, INSTANCE, "")),
        family("baked instances", file(TRIANGLE, &list(MANY, baked), "")),
        family("parts of .obj files", file(&list(40, parts), g0, "")),
        family("paths of one file", file(&list(500, paths), g0, "")),
        family("opacity masks", file(&other("leaves"), g0, red)),
        family("one baked part", file(&other("wide"), r#"{"geometry":"g1","bake":"all"}"#, red)),
        family("large baked parts", file(&other("large"), &list(8, baked_parts), red)),
        family("materials without a library", file(&other("unpainted"), g0, red)),
        family("a large part twice", file(&other("large"), g0, red)),
        family("materials of .obj files", file(&other("painted"), g0, red)),
        family("joined lines", file(&other("joined"), g0, red)),
        family("baked parts of .obj files", file(&other("second"), &list(60, baked_parts), red)),
        family("groups", file(&list(600, groups), g0, "")),
        family("much to say", file(&list(SAID + 1, said), g0, "")),
    ]
}

/// Texts that are none.
pub(crate) fn bad() -> Vec<Family> {
    let good = file(TRIANGLE, INSTANCE, "");
    let many = |entry: &str| list(300_000, |_| entry.to_owned());
    let instances = list(MORE, |_| INSTANCE.to_owned());
    let deep = "[".repeat(100_000) + &"]".repeat(100_000);
    let deep_object = "{\"a\":".repeat(100_000) + "1" + &"}".repeat(100_000);
    // Each becomes six bytes where it is quoted.
    let odd = "\u{7f}".repeat(200_000);
    let escaped = "\\u007f".repeat(50_000);
    let instance = |field: &str| file(TRIANGLE, &format!(r#"{{"geometry":"g",{field}}}"#), "");
    let all = vec![
        family(
            "a list twice",
            good.replace("\"instances\"", &format!("\"instances\":[{instances}],\"instances\"")),
        ),
        family("a name twice", file(&list(2, |_| TRIANGLE.to_owned()), &instances, "")),
        family("empty instances", file(TRIANGLE, &many("{}"), "")),
        family("empty lists as instances", file(TRIANGLE, &many("[]"), "")),
        family("empty geometries", file(&many("{}"), INSTANCE, "")),
        family(
            "empty materials",
            file(TRIANGLE, INSTANCE, &format!(",\"materials\":[{}]", many("{}"))),
        ),
        family("empty keys", instance(&format!("\"keys\":[{}]", many("{}")))),
        family(
            "empty positions",
            file(
                &format!(r#"{{"name":"g","positions":[{}],"triangles":[]}}"#, many("[]")),
                INSTANCE,
                "",
            ),
        ),
        family(
            "empty spheres",
            file(&format!(r#"{{"name":"g","spheres":[{}]}}"#, many("{}")), INSTANCE, ""),
        ),
        family("many factors", instance(&format!("\"scale\":[{}]", many("1")))),
        family("empty factors", instance(&format!("\"scale\":[{}]", many("[]")))),
        family("a scale of objects", instance(&format!("\"scale\":{{\"a\":[{}]}}", many("{}")))),
        family("deep scale", instance(&format!("\"scale\":{deep}"))),
        family("deep keys", instance(&format!("\"keys\":{deep}"))),
        family("deep name", file(&format!("{{\"name\":{deep_object}}}"), INSTANCE, "")),
        family("deep lists", file(&deep, INSTANCE, "")),
        family("deep field", instance(&format!("\"colour\":{deep_object}"))),
        family("deep file", deep_object.clone()),
        family("long field", instance(&format!("\"{odd}\":1"))),
        family("long escaped field", instance(&format!("\"{escaped}\":1"))),
        family(
            "long field of the file",
            good.replace("\"format\"", &format!("\"{odd}\":1,\"format\"")),
        ),
        family("long word for a number", instance(&format!("\"mask\":\"{odd}\""))),
        family(
            "words that do not count",
            instance(&format!("\"mask\":\"{}\"", "\u{7f}".repeat(4096))),
        ),
        family("long word for a list", instance(&format!("\"keys\":\"{escaped}\""))),
        family("long word for a scale", instance(&format!("\"scale\":\"{odd}\""))),
        family("long word for an object", file(&format!("\"{odd}\""), INSTANCE, "")),
        family("long culling", instance(&format!("\"culling\":\"{odd}\""))),
        family("long light", file(TRIANGLE, INSTANCE, &format!(",\"lights\":[{{\"{odd}\":1}}]"))),
        family("long field of a key", instance(&format!("\"keys\":[{{\"{odd}\":1}}]"))),
        family("long format", good.replace("splitplane-scene", &odd)),
        family("long name that nothing has", instance(&format!("\"material\":\"{odd}\""))),
        family("long path", file(&format!(r#"{{"name":"g","obj":"{odd}"}}"#), INSTANCE, "")),
        family(
            "long environment",
            file(TRIANGLE, INSTANCE, &format!(",\"environment\":{{\"file\":\"{odd}\"}}")),
        ),
        family(
            "spheres and a long environment",
            file(
                &spheres(),
                INSTANCE,
                &format!(",\"environment\":{{\"file\":\"{}\"}}", "x".repeat(60_000)),
            ),
        ),
        family(
            "spheres and a long path",
            file(
                &format!("{},{{\"name\":\"h\",\"obj\":\"{}\"}}", spheres(), "x".repeat(60_000)),
                INSTANCE,
                "",
            ),
        ),
        family("long number", instance(&format!("\"mask\":{}", "1".repeat(300_000)))),
        family("long fraction", instance(&format!("\"scale\":0.{}e", "1".repeat(300_000)))),
        family("cut off", file(TRIANGLE, &instances, "").split_at(400_000).0.to_owned()),
        family("no scene", "[".to_owned() + &many("{}") + "]"),
    ];
    all.into_iter().map(|own| Family { is_scene: false, ..own }).collect()
}
