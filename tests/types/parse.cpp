// Parses the editor definitions, from the standard input, with the parser of the Luau that we link.
// Prints each error; ends with 1 if there is one.
#include "Luau/Parser.h"

#include <iostream>
#include <iterator>

int main()
{
    const std::string text{std::istreambuf_iterator<char>(std::cin), {}};
    Luau::Allocator allocator;
    Luau::AstNameTable names{allocator};
    Luau::ParseOptions options;
    options.allowDeclarationSyntax = true;
    const auto result = Luau::Parser::parse(text.data(), text.size(), names, allocator, options);
    for (const Luau::ParseError& error : result.errors)
        std::cout << "spykee.d.luau:" << error.getLocation().begin.line + 1 << ": " << error.what() << "\n";
    return result.errors.empty() && !text.empty() ? 0 : 1;
}
