// Luau for CodeMirror: colours of words, indentation, brackets.

import { StreamLanguage } from "@codemirror/language";

const words = (text) => new Set(text.split(" "));
export const KEYWORDS = words("and break continue do else elseif end for function if in local not or repeat return then until while");
const ATOMS = words("false nil true");
const OPENS = words("do function repeat then ( [ {");
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

function word(stream, state) {
  const [found] = stream.match(/^[A-Za-z_]\w*/);
  const member = state.before === "." || state.before === ":";
  state.before = found;
  if (!member && KEYWORDS.has(found)) {
    state.depth += Number(OPENS.has(found)) - Number(CLOSES.has(found));
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
  state.depth = Math.max(0, state.depth + Number(OPENS.has(sign)) - Number(CLOSES.has(sign)));
  return /[()[\]{}]/.test(sign) ? "bracket" : /[,;.:]/.test(sign) ? "punctuation" : "operator";
}

export const luau = StreamLanguage.define({
  name: "luau",
  startState: () => ({ inside: null, before: "", depth: 0 }),
  token,
  indent: (state, after, { unit }) => Math.max(0, state.depth - Number(/^\s*(?:end\b|until\b|else|[)\]}])/.test(after))) * unit,
  languageData: {
    closeBrackets: { brackets: ["(", "[", "{", "\"", "`"] },
    commentTokens: { line: "--" },
    indentOnInput: /^\s*(?:end|until|else|elseif|[)\]}])$/,
  },
});
