// Validates messages against the JSON Schema that the program generates from its own types.

/** Returns what is wrong with a value, or an empty string. */
export function mistake(schema, value, root = schema, at = "message") {
  if (schema === true || schema === undefined) {
    return "";
  }
  if (schema.$ref) {
    const path = schema.$ref.replace(/^#\//, "").split("/");
    return mistake(path.reduce((inner, key) => inner?.[key], root), value, root, at);
  }
  const choices = schema.oneOf ?? schema.anyOf;
  if (choices) {
    const kind = value?.type;
    const same = (one) => one.properties?.type?.const === kind || one.properties?.type === undefined;
    const tried = choices.filter((one) => kind === undefined || same(one));
    const wrong = tried.map((one) => mistake(one, value, root, at));
    if (!wrong.includes("")) {
      return wrong[0] ?? `${at}: unknown type`;
    }
  }
  if (schema.const !== undefined && schema.const !== value) {
    return `${at} is not ${schema.const}`;
  }
  if (schema.enum && !schema.enum.includes(value)) {
    return `${at} is none of ${schema.enum.join(", ")}`;
  }
  const types = schema.type === undefined ? null : [schema.type].flat();
  if (types && !types.some((type) => is(type, value))) {
    return `${at} is not of type ${types.join(" or ")}`;
  }
  if (Array.isArray(value)) {
    return items(schema, value, root, at);
  }
  if (value !== null && typeof value === "object") {
    const missing = (schema.required ?? []).find((key) => !(key in value));
    if (missing) {
      return `${at}.${missing} is missing`;
    }
    for (const [key, inner] of Object.entries(schema.properties ?? {})) {
      const wrong = key in value ? mistake(inner, value[key], root, `${at}.${key}`) : "";
      if (wrong) {
        return wrong;
      }
    }
  }
  return "";
}

function items(schema, value, root, at) {
  const wrong = value.map((item, index) => {
    const inner = schema.prefixItems?.[index] ?? schema.items;
    return mistake(inner, item, root, `${at}[${index}]`);
  });
  return wrong.find((one) => one) ?? "";
}

function is(type, value) {
  switch (type) {
    case "null": return value === null;
    case "array": return Array.isArray(value);
    case "object": return value !== null && typeof value === "object" && !Array.isArray(value);
    case "integer": return Number.isInteger(value);
    default: return typeof value === type;
  }
}
