//! What the plan models beside the twelve coefficients, what that costs, and what limits the test.

use crate::model;
use crate::report::figure::{Color, Curve, Dash, Figure, Mark, Panel, Scale, Shape, Style};
use crate::report::words;
use crate::results::{EvaluationDocument, LimitRecord, RoleRecord};
use crate::wording::{number, optional, separability};

use super::blocks::{Block, HtmlTable, Section};
use super::subject::Subject;

/// The sections of a page.
pub(super) fn sections(subject: &Subject, limits: &[LimitRecord]) -> Vec<Section> {
    let d = &subject.document;
    let mut blocks = vec![Block::Text(words::perfect(&d.inputs))];
    blocks.extend(parameters(d).into_iter().map(Block::Table));
    if !d.budget.is_empty() {
        blocks.push(Block::Text(
            "The budget of errors: what a filter would add that ignored a group and estimated the \
             rest. Above the dotted line ignoring it costs more than the whole test leaves."
                .to_owned(),
        ));
        blocks.push(Block::Wide {
            caption:
                "RMS error of the twelve coefficients if a group is ignored. Crosses are groups \
                      that the filter ignores already."
                    .to_owned(),
            svg: budget_picture(d),
        });
        blocks.push(Block::Table(budget(d)));
    }
    let mut sections = vec![Section::new("errors", "What the plan models", blocks)];
    if !limits.is_empty() {
        sections.push(Section::new(
            "limits",
            "What limits this test",
            vec![
                Block::Text(words::LIMITS.to_owned()),
                Block::Table(limits_table(limits)),
            ],
        ));
    }
    sections
}

fn title(group: &str) -> &str {
    model::group(group).map_or(group, |g| g.title)
}

/// Parameters beside the twelve coefficients, a table for each group.
fn parameters(d: &EvaluationDocument) -> Vec<HtmlTable> {
    let others = &d.parameters[d.coefficients.len()..];
    let claims = others.iter().any(|p| p.claimed_sigma.is_some());
    let specified = others.iter().any(|p| p.spec.is_some());
    let groups = others.chunk_by(|a, b| (&a.group, a.role) == (&b.group, b.role));
    let table = |group: &[crate::results::ParameterRecord]| {
        let estimated = group[0].role == RoleRecord::Estimated;
        let mut columns = vec!["parameter", "before"];
        if estimated {
            columns.push("after");
            if claims {
                columns.push("as the filter claims");
            }
            columns.extend(["times better", "order", "separability"]);
            if specified {
                columns.push("specification");
            }
        }
        let rows = group.iter().map(|p| {
            let mut row = vec![p.name.clone(), number(p.prior_sigma)];
            if estimated {
                row.push(number(p.sigma));
                if claims {
                    row.push(optional(p.claimed_sigma, number));
                }
                row.push(number(p.prior_sigma / p.sigma));
                row.push(optional(p.observability_order, |o| o.to_string()));
                row.push(optional(p.separability, separability));
                if specified {
                    row.push(optional(p.spec, number));
                }
            }
            row
        });
        let ignored = match estimated {
            true => "",
            false => ", not known to the filter",
        };
        let name = title(&group[0].group);
        let caption = format!(
            "{}{}, 1σ, {}{ignored}",
            name[..1].to_uppercase(),
            &name[1..],
            group[0].unit
        );
        HtmlTable::new(&caption, &columns, rows.collect())
    };
    groups.map(table).collect()
}

fn budget(d: &EvaluationDocument) -> HtmlTable {
    let rows = d.budget.iter().map(|b| {
        vec![
            title(&b.group).to_owned(),
            match b.role {
                RoleRecord::Estimated => "estimated",
                RoleRecord::Considered => "ignored",
            }
            .to_owned(),
            number(b.rms_error_if_ignored_deg_per_h),
            optional(b.ratio, |r| format!("{r:.2}")),
            optional(b.worst.as_ref(), |w| {
                format!("{} {:.2}", w.name.name(), w.ratio)
            }),
        ]
    });
    HtmlTable::new(
        "What ignoring a group adds to the errors of the coefficients",
        &[
            "group",
            "by the filter",
            "RMS error if ignored, °/h",
            "beside RMS σ",
            "worst, beside its σ",
        ],
        rows.collect(),
    )
}

fn budget_picture(d: &EvaluationDocument) -> String {
    let count = d.budget.len() as f64;
    let symbol = |group: &str| model::group(group).map_or(group, |g| g.symbol).to_owned();
    let names = d.budget.iter().map(|b| symbol(&b.group)).collect();
    let line = Style {
        color: Color::Black,
        dash: Dash::Dotted,
        width: 1.4,
    };
    let rms = d.rms_sigma_deg_per_h;
    let mut panel = Panel::new("", "group", "RMS error, °/h")
        .with_x_names(names)
        .with_x_range(0.0, count + 1.0)
        .with_y_scale(Scale::Log)
        .with_curve(Curve::new(
            "RMS σ of the plan",
            line,
            vec![[0.0, rms], [count + 1.0, rms]],
        ));
    for (i, b) in d.budget.iter().enumerate() {
        let error = b.rms_error_if_ignored_deg_per_h;
        // Nothing to show on a logarithmic scale.
        if error <= 0.0 {
            continue;
        }
        let (shape, color) = match b.role {
            RoleRecord::Estimated => (Shape::Dot, Color::Blue),
            RoleRecord::Considered => (Shape::Cross, Color::Vermillion),
        };
        let said = format!("{}: {} °/h", title(&b.group), number(error));
        panel = panel.with_mark(Mark::new([i as f64 + 1.0, error], shape, color, said));
    }
    Figure::new(1)
        .with_panel_size(720.0, 300.0)
        .with_id("budget")
        .with_label(
            "RMS error of the coefficients if a group is ignored; the table has the numbers",
        )
        .with_panel(panel)
        .to_svg()
}

fn limits_table(limits: &[LimitRecord]) -> HtmlTable {
    let rows = limits.iter().map(|l| {
        vec![
            l.what.clone(),
            l.change
                .replace(" arcsec", "″")
                .replace(" deg wider", "° wider"),
            format!("{:.4}", l.criterion_ratio),
            words::gained(l.criterion_ratio),
        ]
    });
    HtmlTable::new(
        "What would help, the most helpful first",
        &["what", "change", "criterion, ratio", "which is"],
        rows.collect(),
    )
}
