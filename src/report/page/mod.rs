//! Pages: one self-contained HTML file that shows a design, a comparison, an estimate or a
//! calibration.
//!
//! A page is a template, a style sheet, scripts and one JSON object with the data, all in one file
//! that opens without a network. The scripts draw: a ball to turn (each pixel's dot is computed in a
//! fragment shader, so that rims are sharp at any size), shaded meshes, and charts as SVG with values
//! on hover and by keyboard. They are the project's own, some 100 kB; a plotting library that does
//! the same (plotly.js) has 4.6 MB.
//!
//! Guaranteed: no reference to anything outside the file, and text from files never becomes markup.
//! Not guaranteed: a view without WebGL 2, where the page says so and shows all else.

#[cfg(feature = "vision")]
mod calibrate;
mod compare;
mod design;
#[cfg(feature = "vision")]
mod estimate;
mod features;
mod mesh;
mod stencil;

use serde::Serialize;

use crate::error::{Error, Result};

#[cfg(feature = "vision")]
pub use calibrate::CalibrationPage;
pub use design::{CameraFigures, DesignPage};
#[cfg(feature = "vision")]
pub use estimate::{Carried, EstimatePage, PageBall, PageFrame, PageSpin, ShownBall};

/// Name of a page's file within its folder.
pub const PAGE: &str = "report.html";

const TEMPLATE: &str = include_str!("page.html");
const STYLE: &str = include_str!("page.css");
const SCRIPTS: [&str; 9] = [
    include_str!("core.js"),
    include_str!("chart.js"),
    include_str!("view.js"),
    include_str!("layout.js"),
    include_str!("design.js"),
    include_str!("compare.js"),
    include_str!("estimate.js"),
    include_str!("calibrate.js"),
    include_str!("start.js"),
];

/// A page's words and data.
#[derive(Debug, Serialize)]
struct PageData<'a, T> {
    /// Which script draws it.
    kind: &'static str,
    title: &'a str,
    subtitle: &'a str,
    content: &'a T,
}

impl<T: Serialize> PageData<'_, T> {
    /// The whole file.
    ///
    /// # Errors
    /// [`Error::Internal`] where the data are no JSON.
    fn html(&self) -> Result<String> {
        let data = serde_json::to_string(self)
            .map_err(|e| Error::Internal(format!("page as JSON: {e}")))?;
        let title = escaped(self.title);
        Ok(filled(|name| match name {
            "title" => Some(title.clone()),
            "version" => Some(env!("CARGO_PKG_VERSION").to_owned()),
            "style" => Some(STYLE.to_owned()),
            "script" => Some(SCRIPTS.concat()),
            // Within a script only `<` can end it or begin a comment.
            "data" => Some(data.replace('<', "\\u003c")),
            _ => None,
        }))
    }
}

/// The template with each `{{name}}` replaced once; what is put in is not searched again.
fn filled(value: impl Fn(&str) -> Option<String>) -> String {
    let mut text = String::new();
    let mut rest = TEMPLATE;
    while let Some((before, after)) = rest.split_once("{{") {
        text.push_str(before);
        let Some((name, behind)) = after.split_once("}}") else {
            text.push_str("{{");
            rest = after;
            continue;
        };
        match value(name) {
            Some(value) => text.push_str(&value),
            None => text.push_str(&format!("{{{{{name}}}}}")),
        }
        rest = behind;
    }
    text.push_str(rest);
    text
}

/// Text as HTML.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

/// A number with at most six decimals: enough for drawing, half as long in a file.
fn rounded(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_cannot_leave_their_element() {
        let evil = "</script><script>alert(1)</script>{{script}}<!--";
        let page = PageData {
            kind: "design",
            title: evil,
            subtitle: evil,
            content: &evil,
        };
        let html = page.html().expect("text is JSON");
        assert_eq!(html.matches("</script>").count(), 2);
        assert!(!html.contains("<!--") && !html.contains("alert(1)</"));
        // What came from outside is not taken for a template.
        assert!(html.contains("{{script}}"));
    }

    #[test]
    fn nothing_is_fetched() {
        let page = PageData {
            kind: "design",
            title: "t",
            subtitle: "s",
            content: &0,
        };
        let html = page.html().expect("a number is JSON");
        for outside in ["http://", "https://", "@import", "url(", "src="] {
            let found = html.matches(outside).count();
            // The name space of SVG is a name, not an address.
            let names = if outside == "http://" { 1 } else { 0 };
            assert_eq!(found, names, "{outside}");
        }
    }
}
