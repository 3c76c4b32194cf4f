// Luau for CodeMirror: colours of words, indentation, brackets.

import { StreamLanguage } from "@codemirror/language";

const words = (text) => new Set(text.split(" "));
export const KEYWORDS = words("and break continue do else elseif end for function if in local not or repeat return then until while");
const ATOMS = words("false nil true");
/** What opens a block or a bracket, and how the line begins that closes it. */
const OPENS = {
  do: /^\s*end\b/, function: /^\s*end\b/, then: /^\s*(?:end\b|else)/, repeat: /^\s*until\b/,
  "(": /^\s*\)/, "[": /^\s*\]/, "{": /^\s*\}/,
};
const CLOSES = words("end until elseif ) ] }");
const ESCAPE = /^\\(?:z\s*|x[\da-fA-F]{2}|u\{[\da-fA-F]+\}|\d{1,3}|.?)/;

/** The text of a string or comment until `end`, which may be on a later line. */
function until(end, style, escapes) {
  return (stream, state) => {
    while (!stream.eol()) {
      if (stream.match(end)) {
        state.inside = null;
        return style;
      }
      if (!(escapes && stream.match(ESCAPE))) {
        stream.next();
      }
    }
    // A string in quotes ends with its line.
    if (escapes && end !== "`") {
      state.inside = null;
    }
    return style;
  };
}

function begin(stream, state, end, style, escapes) {
  state.inside = until(end, style, escapes);
  return state.inside(stream, state);
}

/** What is open indents by one step from its own line. */
function nest(stream, state, sign) {
  if (CLOSES.has(sign)) {
    state.open.pop();
  }
  if (Object.hasOwn(OPENS, sign)) {
    state.open.push({ sign, indentation: stream.indentation() });
  }
}

function word(stream, state) {
  const [found] = stream.match(/^[A-Za-z_]\w*/);
  const before = state.before;
  const member = before === "." || before === ":";
  state.before = found;
  if (!member && KEYWORDS.has(found)) {
    // An `if` within an expression has no `end`.
    if (found === "if") {
      state.expression = /^(?:[=(,{[<>+\-*/]|return|and|or|not)$/.test(before);
    } else if (found !== "then" || !state.expression) {
      nest(stream, state, found);
    }
    return "keyword";
  }
  if (!member && ATOMS.has(found)) {
    return "atom";
  }
  return stream.match(/^\s*[("{`]/, false) ? "variableName.function" : member ? "propertyName" : "variableName";
}

function token(stream, state) {
  if (state.inside) {
    return state.inside(stream, state);
  }
  if (stream.eatSpace()) {
    return null;
  }
  const [long, comment, equals] = stream.match(/^(--)?\[(=*)\[/) || [];
  if (long) {
    return begin(stream, state, `]${equals}]`, comment ? "comment" : "string", false);
  }
  if (stream.match("--")) {
    stream.skipToEnd();
    return "comment";
  }
  if (stream.match(/^(?:0[xX][\da-fA-F_]+|0[bB][01_]+|(?:\d[\d_]*\.?[\d_]*|\.\d[\d_]*)(?:[eE][+-]?\d+)?)/)) {
    state.before = "1";
    return "number";
  }
  if (/[A-Za-z_]/.test(stream.peek())) {
    return word(stream, state);
  }
  const sign = stream.next();
  state.before = sign;
  if (sign === "\"" || sign === "'" || sign === "`") {
    return begin(stream, state, sign, "string", true);
  }
  nest(stream, state, sign);
  return /[()[\]{}]/.test(sign) ? "bracket" : /[,;.:]/.test(sign) ? "punctuation" : "operator";
}

export const luau = StreamLanguage.define({
  name: "luau",
  startState: () => ({ inside: null, before: "", open: [], expression: false }),
  token,
  indent({ open }, after, { unit }) {
    const last = open.at(-1);
    return last === undefined ? 0 : last.indentation + (OPENS[last.sign].test(after) ? 0 : unit);
  },
  languageData: {
    closeBrackets: { brackets: ["(", "[", "{", "\"", "`"] },
    commentTokens: { line: "--" },
    indentOnInput: /^\s*(?:end|until|else|elseif|[)\]}])$/,
  },
});
