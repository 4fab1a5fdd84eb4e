//! A minimal SVG writer: escaped text and coordinates with two decimals, so that output is stable and diffs
//! are small.

use std::fmt::Write;

/// An SVG element under construction. Lengths in CSS pixels, y downwards.
pub struct Svg {
    body: String,
}

/// Where the anchor of a text lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// At its left end.
    Start,
    /// In its middle.
    Middle,
    /// At its right end.
    End,
}

impl Svg {
    /// A white canvas.
    pub fn new(width: f64, height: f64) -> Self {
        let mut body = String::new();
        let _ = write!(
            body,
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" width=\"{width:.0}\" \
             height=\"{height:.0}\" font-family=\"Helvetica, Arial, sans-serif\">\n\
             <rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n"
        );
        Self { body }
    }

    /// A straight line.
    pub fn line(&mut self, from: [f64; 2], to: [f64; 2], color: &str, width: f64) {
        let ([x1, y1], [x2, y2]) = (from, to);
        let _ = writeln!(
            self.body,
            "<line x1=\"{x1:.2}\" y1=\"{y1:.2}\" x2=\"{x2:.2}\" y2=\"{y2:.2}\" stroke=\"{color}\" stroke-width=\"{width}\"/>"
        );
    }

    /// A filled rectangle.
    pub fn rectangle(&mut self, corner: [f64; 2], size: [f64; 2], fill: &str, opacity: f64) {
        let ([x, y], [w, h]) = (corner, size);
        let _ = writeln!(
            self.body,
            "<rect x=\"{x:.2}\" y=\"{y:.2}\" width=\"{w:.2}\" height=\"{h:.2}\" fill=\"{fill}\" fill-opacity=\"{opacity}\"/>"
        );
    }

    /// A rectangle's outline.
    pub fn frame(&mut self, corner: [f64; 2], size: [f64; 2], color: &str) {
        let ([x, y], [w, h]) = (corner, size);
        let _ = writeln!(
            self.body,
            "<rect x=\"{x:.2}\" y=\"{y:.2}\" width=\"{w:.2}\" height=\"{h:.2}\" fill=\"none\" stroke=\"{color}\"/>"
        );
    }

    /// Joined points.
    pub fn polyline(&mut self, points: &[[f64; 2]], color: &str, width: f64, dashed: bool) {
        let list: Vec<String> = points.iter().map(|[x, y]| format!("{x:.2},{y:.2}")).collect();
        let dash = if dashed { " stroke-dasharray=\"7 4\"" } else { "" };
        let _ = writeln!(
            self.body,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"{width}\" stroke-linejoin=\"round\"{dash}/>",
            list.join(" ")
        );
    }

    /// A filled polygon.
    pub fn polygon(&mut self, points: &[[f64; 2]], fill: &str) {
        let list: Vec<String> = points.iter().map(|[x, y]| format!("{x:.2},{y:.2}")).collect();
        let _ = writeln!(self.body, "<polygon points=\"{}\" fill=\"{fill}\"/>", list.join(" "));
    }

    /// A filled circle.
    pub fn circle(&mut self, center: [f64; 2], radius: f64, fill: &str) {
        let [x, y] = center;
        let _ =
            writeln!(self.body, "<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{radius:.2}\" fill=\"{fill}\"/>");
    }

    /// A text, turned by `degrees` about its anchor.
    pub fn text(&mut self, at: [f64; 2], text: &str, size: f64, anchor: Anchor, degrees: f64, color: &str) {
        let [x, y] = at;
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        let turn = if degrees == 0.0 {
            String::new()
        } else {
            format!(" transform=\"rotate({degrees} {x:.2} {y:.2})\"")
        };
        let _ = writeln!(
            self.body,
            "<text x=\"{x:.2}\" y=\"{y:.2}\" font-size=\"{size}\" text-anchor=\"{anchor}\" fill=\"{color}\"{turn}>{}</text>",
            escape(text)
        );
    }

    /// Draws what `content` draws, cut at a rectangle.
    pub fn clipped(&mut self, corner: [f64; 2], size: [f64; 2], content: impl FnOnce(&mut Self)) {
        let ([x, y], [w, h]) = (corner, size);
        // Nested viewports clip without ids, which would clash where several charts share one HTML page.
        let _ = writeln!(
            self.body,
            "<svg x=\"{x:.2}\" y=\"{y:.2}\" width=\"{w:.2}\" height=\"{h:.2}\" viewBox=\"{x:.2} {y:.2} {w:.2} {h:.2}\" \
             overflow=\"hidden\">"
        );
        content(self);
        self.body.push_str("</svg>\n");
    }

    /// The finished element.
    pub fn finish(mut self) -> String {
        self.body.push_str("</svg>\n");
        self.body
    }
}

/// Text with the characters that XML reserves replaced by entities; control characters are dropped.
pub fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '&' => escaped.push_str("&amp;"),
            '"' => escaped.push_str("&quot;"),
            c if c.is_control() => {}
            c => escaped.push(c),
        }
    }
    escaped
}
