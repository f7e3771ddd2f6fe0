/* Numbers in text files: one walk over a bounded buffer, no locale, no allocation. */
#ifndef SC_IMPORT_NUMBER_TEXT_H
#define SC_IMPORT_NUMBER_TEXT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* A place in a text of known length; the text need not end with a 0. */
struct number_text {
    const char *at, *end;
    size_t line; /* counted from 1 */
};

struct number_text number_text_start(const void *data, size_t size);

/* Skips blanks and tabs; true if the line (or the text) ends here. */
bool number_text_at_line_end(struct number_text *text);

/* True at the end of the text, after blanks and empty lines. */
bool number_text_at_end(struct number_text *text);

/* Goes behind the next line end. */
void number_text_next_line(struct number_text *text);

/* A decimal number followed by a blank, a comma, a line end or the end. False, without moving, if
 * there is none, if it is longer than 63 characters or not finite. */
bool number_text_double(struct number_text *text, double *out_value);

/* The same for an integer within int64_t. */
bool number_text_integer(struct number_text *text, int64_t *out_value);

/* The next run of other characters than blanks, at most capacity - 1 of them; false if there is
 * none on this line or it is longer. */
bool number_text_word(struct number_text *text, char *out_word, size_t capacity);

#ifdef __cplusplus
}
#endif
#endif
