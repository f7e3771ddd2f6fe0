#include "app/app.h"
#include "app/commands.h"
#include "base/picture.h"
#include "base/sheet.h"

#include <stdlib.h>
#include <string.h>

enum { MAX_PICTURES = 64 };

struct pictures {
    char *text[MAX_PICTURES]; /* FILE|caption|detail, cut at the bars */
    struct sheet_cell cell[MAX_PICTURES];
    int count;
};

static void pictures_fini(struct pictures *p) {
    for (int i = 0; i < p->count; i++) {
        free(p->text[i]);
        image_u8_destroy(&p->cell[i].image);
    }
}

/* Takes one FILE|caption|detail and reads the picture. */
static enum st add_picture(struct pictures *p, const char *argument, struct errctx *err) {
    if (p->count == MAX_PICTURES)
        return errctx_set(err, ST_INVALID, "more than %d pictures", MAX_PICTURES);
    size_t size = strlen(argument) + 1;
    char *text = malloc(size);
    if (!text)
        return errctx_set(err, ST_NOMEM, "out of memory");
    memcpy(text, argument, size);
    struct sheet_cell *cell = &p->cell[p->count];
    p->text[p->count] = text;
    p->count++;
    char *caption = strchr(text, '|'), *detail = NULL;
    if (caption) {
        *caption++ = 0;
        detail = strchr(caption, '|');
        if (detail)
            *detail++ = 0;
    }
    cell->caption = caption ? caption : text;
    cell->detail = detail;
    return picture_read_rgb(text, &cell->image, err);
}

/* By the name's ending: .jpg is a JPEG, all else a PNG. */
static enum st write_sheet(const char *path, const struct image_u8 *page, struct errctx *err) {
    const char *ending = strrchr(path, '.');
    if (ending && !strcmp(ending, ".jpg"))
        return picture_write_jpeg(path, page, 85, err);
    return picture_write_png(path, page, err);
}

int cmd_sheet(int argc, const char **argv) {
    char *output = NULL, *title = NULL, *subtitle = NULL;
    int columns = 3, width_px = 480;
    struct poptOption options[] = {
        {"output", 'o', POPT_ARG_STRING, &output, 0, "the sheet (.png or .jpg)", "FILE"},
        {"title", 't', POPT_ARG_STRING, &title, 0, "heading", "TEXT"},
        {"subtitle", 0, POPT_ARG_STRING, &subtitle, 0, "line below it", "TEXT"},
        {"columns", 'c', POPT_ARG_INT | POPT_ARGFLAG_SHOW_DEFAULT, &columns, 0, "pictures in a row",
         "N"},
        {"width", 'w', POPT_ARG_INT | POPT_ARGFLAG_SHOW_DEFAULT, &width_px, 0,
         "of a picture on the sheet, px", "PX"},
        POPT_TABLEEND};
    struct app_usage usage = {
        .name = "sheet",
        .synopsis = "-o FILE PICTURE ...",
        .about = "Puts pictures (PNG, JPEG, PPM) with captions on one sheet. A picture is given as "
                 "FILE, FILE|caption or FILE|caption|second line.\n\n"
                 "Example:\n  scancart sheet -t 'North room' -o sheet.png 'a.png|before|2 of May' "
                 "'b.png|after'",
        .options = options};
    poptContext context = NULL;
    enum st st = app_parse(&usage, argc, argv, &context);
    if (st)
        return app_parse_exit(st);
    struct errctx err = {0};
    struct pictures pictures = {0};
    struct image_u8 page = {0};
    int exit_status = APP_FAILED;
    const char *argument = poptGetArg(context);
    if (!output || !argument) {
        exit_status = app_usage_error("sheet", "needs -o FILE and at least one picture");
        goto out;
    }
    for (; argument && !st; argument = poptGetArg(context))
        st = add_picture(&pictures, argument, &err);
    struct sheet sheet = {.title = title ? title : "",
                          .subtitle = subtitle,
                          .cells = pictures.cell,
                          .cell_count = pictures.count,
                          .columns = columns,
                          .cell_width_px = width_px};
    if (!st)
        st = sheet_render(&sheet, &page, &err);
    if (!st)
        st = write_sheet(output, &page, &err);
    exit_status = st ? app_fail("sheet", &err) : APP_DONE;
out:
    image_u8_destroy(&page);
    pictures_fini(&pictures);
    free(output);
    free(title);
    free(subtitle);
    (void)poptFreeContext(context);
    return exit_status;
}
