// Type-checks scripts as luau-lsp does, with both of Luau's solvers: `check FOLDER MODE SCRIPT...`. `FOLDER`
// is one that `spykee new` has made: it has the editor definitions and a stub of each module. Each script
// is read as if it began with `--!MODE`. Prints each error, once a line and solver; ends with 1 if there is
// one, with 2 if the definitions themselves are wrong.
#include "Luau/BuiltinDefinitions.h"
#include "Luau/ConfigResolver.h"
#include "Luau/Error.h"
#include "Luau/FileResolver.h"
#include "Luau/Frontend.h"

#include <fstream>
#include <iostream>
#include <iterator>

static std::optional<std::string> read(const std::string& path)
{
    std::ifstream file(path);
    if (!file)
        return std::nullopt;
    return std::string{std::istreambuf_iterator<char>(file), {}};
}

struct Files : Luau::FileResolver
{
    std::string folder, mode;

    std::optional<Luau::SourceCode> readSource(const Luau::ModuleName& name) override
    {
        auto text = read(name);
        if (!text)
            return std::nullopt;
        return Luau::SourceCode{"--!" + mode + "\n" + *text, Luau::SourceCode::Module};
    }

    std::optional<Luau::ModuleInfo> resolveModule(
        const Luau::ModuleInfo* from, Luau::AstExpr* path, const Luau::TypeCheckLimits&) override
    {
        const auto* constant = path->as<Luau::AstExprConstantString>();
        if (!constant || !from)
            return std::nullopt;
        const std::string name(constant->value.data, constant->value.size);
        if (name.rfind("@spykee/", 0) == 0)
            return Luau::ModuleInfo{folder + "/.spykee/" + name.substr(8) + ".luau", false};
        return Luau::ModuleInfo{from->name.substr(0, from->name.rfind('/') + 1) + name + ".lua", false};
    }
};

static int check(Files& files, const std::string& definitions, Luau::SolverMode solver, const std::string& script)
{
    Luau::NullConfigResolver config;
    Luau::Frontend frontend(solver, &files, &config);
    Luau::registerBuiltinGlobals(frontend, frontend.globals);
    auto& globals = frontend.globals;
    const auto loaded = frontend.loadDefinitionFile(globals, globals.globalScope, definitions, "@spykee", false);
    for (const auto& error : loaded.parseResult.errors)
        std::cout << "spykee.d.luau:" << error.getLocation().begin.line + 1 << ": " << error.what() << "\n";
    if (loaded.module)
        for (const auto& error : loaded.module->errors)
            std::cout << "spykee.d.luau:" << error.location.begin.line + 1 << ": " << Luau::toString(error) << "\n";
    if (!loaded.success)
        exit(2);
    const std::string which = solver == Luau::SolverMode::New ? " (new solver)" : "";
    int errors = 0;
    for (const auto& error : frontend.check(script).errors)
    {
        // The line with the mode stands before the first.
        std::cout << script << ":" << error.location.begin.line << which << ": " << Luau::toString(error) << "\n";
        errors += 1;
    }
    return errors;
}

int main(int count, char** arguments)
{
    Files files;
    files.folder = arguments[1];
    files.mode = arguments[2];
    const auto definitions = read(files.folder + "/spykee.d.luau");
    int errors = definitions ? 0 : 1;
    for (int at = 3; definitions && at < count; ++at)
        for (auto solver : {Luau::SolverMode::Old, Luau::SolverMode::New})
            errors += check(files, *definitions, solver, arguments[at]);
    std::cout << count - 3 << " scripts, " << errors << " errors\n";
    return errors > 0;
}
