//! 3MF files: a zip package with a model in XML.
//!
//! Format: 3MF Core Specification 1.3 (3MF Consortium), sections 2 (package) and 3 (model). The
//! model part has its customary path, `3D/3dmodel.model`: some readers look for it there without
//! following the package's relationships. The same meshes give the same bytes.

use std::fmt::Write as _;
use std::io::{Cursor, Write as _};

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

use crate::error::{Error, Result};

use super::Mesh;

/// The kinds of parts that the package holds.
const CONTENT_TYPES: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
 <Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
 <Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>
</Types>
"#;
/// Where the package's model lies.
const RELATIONSHIPS: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
 <Relationship Target="/3D/3dmodel.model" Id="rel0" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>
</Relationships>
"#;

/// A mesh to print, with its name and its place on the bed.
pub(super) struct Object<'a> {
    /// Name, free of characters that XML reserves.
    pub name: String,
    /// The solid, rounded to 32-bit floats, mm.
    pub mesh: &'a Mesh,
    /// How far it is moved along x, mm.
    pub shift_mm: f64,
}

/// The package as a file's bytes.
///
/// # Errors
/// [`Error::Internal`] where the zip library fails.
pub(super) fn package(title: &str, objects: &[Object<'_>]) -> Result<Vec<u8>> {
    let model = model(title, objects);
    let parts = [
        ("[Content_Types].xml", CONTENT_TYPES),
        ("_rels/.rels", RELATIONSHIPS),
        ("3D/3dmodel.model", &model),
    ];
    // A fixed date: the same stencil gives the same bytes.
    let options = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Deflated)
        .last_modified_time(DateTime::default());
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    let mut write = || -> std::io::Result<()> {
        for (path, text) in parts {
            archive.start_file(path, options)?;
            archive.write_all(text.as_bytes())?;
        }
        Ok(())
    };
    write().map_err(|e| Error::Internal(format!("3MF package: {e}")))?;
    let bytes = archive.finish();
    Ok(bytes
        .map_err(|e| Error::Internal(format!("3MF package: {e}")))?
        .into_inner())
}

/// The model part.
fn model(title: &str, objects: &[Object<'_>]) -> String {
    let mut xml = format!(
        r#"<?xml version="1.0" encoding="UTF-8"?>
<model xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02" unit="millimeter" xml:lang="en-US">
 <metadata name="Title">{title}</metadata>
 <metadata name="Application">spindoe {}</metadata>
 <resources>
"#,
        env!("CARGO_PKG_VERSION")
    );
    for (id, object) in (1..).zip(objects) {
        write_object(&mut xml, id, object);
    }
    xml.push_str(" </resources>\n <build>\n");
    for (id, object) in (1..).zip(objects) {
        let x = object.shift_mm;
        line(
            &mut xml,
            format_args!("  <item objectid=\"{id}\" transform=\"1 0 0 0 1 0 0 0 1 {x} 0 0\"/>"),
        );
    }
    xml.push_str(" </build>\n</model>\n");
    xml
}

/// Appends one object. Coordinates are those of a [`Mesh::rounded`] mesh, written with the fewest
/// digits that read back as the same 32-bit float: every reader sees the topology that was checked.
fn write_object(xml: &mut String, id: usize, object: &Object<'_>) {
    let name = &object.name;
    line(
        xml,
        format_args!(
            "  <object id=\"{id}\" name=\"{name}\" type=\"model\">\n   <mesh>\n    <vertices>"
        ),
    );
    for v in &object.mesh.vertices {
        let [x, y, z] = [v.x as f32, v.y as f32, v.z as f32];
        line(
            xml,
            format_args!("     <vertex x=\"{x}\" y=\"{y}\" z=\"{z}\"/>"),
        );
    }
    line(xml, format_args!("    </vertices>\n    <triangles>"));
    for [a, b, c] in &object.mesh.triangles {
        line(
            xml,
            format_args!("     <triangle v1=\"{a}\" v2=\"{b}\" v3=\"{c}\"/>"),
        );
    }
    line(
        xml,
        format_args!("    </triangles>\n   </mesh>\n  </object>"),
    );
}

/// Appends a line.
fn line(xml: &mut String, words: std::fmt::Arguments<'_>) {
    // Writing to a String cannot fail.
    let _ = writeln!(xml, "{words}");
}
