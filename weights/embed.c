/* Build-time tool: turns the weights files that builtin.def names into one C file of byte arrays.
 *
 *     embed DIRECTORY OUTPUT.c
 *
 * Each row BUILTIN(id, file, ...), file a string relative to DIRECTORY, gives
 *
 *     const unsigned char lull_weights_<id>[];       aligned to 64 bytes
 *     const size_t lull_weights_<id>_bytes;
 *
 * A file named by several rows is stored once for each. Errors: one line on stderr, exit status 1,
 * and no output file. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const struct {
    const char *id, *file;
} builtins[] = {
#define BUILTIN(id, ...) {#id, FIRST(__VA_ARGS__, 0)},
#define FIRST(file, ...) file
#include "builtin.def"
#undef BUILTIN
    {NULL, NULL},
};

static int fail(const char *what, const char *why)
{
    fprintf(stderr, "embed: %s: %s\n", what, why);
    return 0;
}

/* Writes the array of one weights file. Returns 1, or 0 after a message. */
static int embed(FILE *out, const char *directory, const char *id, const char *file)
{
    char path[4096];
    FILE *in;
    unsigned long bytes = 0;
    int c;

    if (snprintf(path, sizeof path, "%s/%s", directory, file) >= (int)sizeof path)
        return fail(file, "path too long");
    in = fopen(path, "rb");
    if (!in)
        return fail(path, strerror(errno));
    fprintf(out, "\nextern const unsigned char lull_weights_%s[];\n", id);
    fprintf(out, "extern const size_t lull_weights_%s_bytes;\n", id);
    fprintf(out, "ALIGNED const unsigned char lull_weights_%s[] = {", id);
    while ((c = getc(in)) != EOF)
        fprintf(out, "%s%d,", bytes++ % 24 ? "" : "\n", c);
    fprintf(out, "\n};\nconst size_t lull_weights_%s_bytes = %luu;\n", id, bytes);
    if (ferror(in) || !bytes) {
        fail(path, bytes ? "cannot read" : "empty file");
        fclose(in);
        return 0;
    }
    fclose(in);
    return 1;
}

int main(int argc, char **argv)
{
    char temporary[4096];
    FILE *out;
    int ok = 1;

    if (argc != 3) {
        fprintf(stderr, "usage: embed DIRECTORY OUTPUT.c\n");
        return 1;
    }
    if (snprintf(temporary, sizeof temporary, "%s.new", argv[2]) >= (int)sizeof temporary)
        return !fail(argv[2], "path too long");
    out = fopen(temporary, "w");
    if (!out)
        return !fail(temporary, strerror(errno));
    fputs("/* Made by weights/embed.c from the files that weights/builtin.def names. */\n"
          "#include <stddef.h>\n\n"
          "#if defined(__GNUC__)\n#define ALIGNED __attribute__((aligned(64)))\n"
          "#else\n#define ALIGNED\n#endif\n",
          out);
    for (size_t i = 0; ok && builtins[i].id; i++)
        ok = embed(out, argv[1], builtins[i].id, builtins[i].file);
    if (fclose(out) && ok)
        ok = fail(temporary, "cannot write");
    remove(argv[2]); /* rename does not replace on every system */
    if (ok && rename(temporary, argv[2]))
        ok = fail(argv[2], strerror(errno));
    if (!ok)
        remove(temporary);
    return !ok;
}
