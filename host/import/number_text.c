#include "import/number_text.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { TOKEN_MAX = 64 };

struct number_text number_text_start(const void *data, size_t size) {
    const char *begin = data;
    struct number_text text = {begin, size ? begin + size : begin, 1};
    return text;
}

static bool is_blank(char c) {
    return c == ' ' || c == '\t' || c == '\r';
}

bool number_text_at_line_end(struct number_text *text) {
    while (text->at < text->end && is_blank(*text->at))
        text->at++;
    return text->at == text->end || *text->at == '\n';
}

void number_text_next_line(struct number_text *text) {
    while (text->at < text->end && *text->at != '\n')
        text->at++;
    if (text->at < text->end) {
        text->at++;
        text->line++;
    }
}

bool number_text_at_end(struct number_text *text) {
    while (number_text_at_line_end(text)) {
        if (text->at == text->end)
            return true;
        number_text_next_line(text);
    }
    return false;
}

bool number_text_word(struct number_text *text, char *out_word, size_t capacity) {
    if (number_text_at_line_end(text))
        return false;
    size_t n = 0;
    while (text->at + n < text->end && !is_blank(text->at[n]) && text->at[n] != '\n')
        n++;
    if (n >= capacity)
        return false;
    memcpy(out_word, text->at, n);
    out_word[n] = 0;
    text->at += n;
    return true;
}

/* Copies the characters of a decimal number that start here; the length, 0 if it is none. */
static size_t token(struct number_text *text, char out[TOKEN_MAX], bool integer) {
    if (number_text_at_line_end(text))
        return 0;
    size_t n = 0;
    while (text->at + n < text->end && n < TOKEN_MAX) {
        const char c = text->at[n];
        const bool digit = c >= '0' && c <= '9';
        const bool sign = c == '-' || c == '+';
        if (!digit && !sign && (integer || !(c == '.' || c == 'e' || c == 'E')))
            break;
        out[n++] = c;
    }
    if (n == 0 || n == TOKEN_MAX)
        return 0;
    if (text->at + n < text->end && !is_blank(text->at[n]) && text->at[n] != '\n' &&
        text->at[n] != ',')
        return 0;
    out[n] = 0;
    return n;
}

bool number_text_double(struct number_text *text, double *out_value) {
    char buffer[TOKEN_MAX];
    const size_t n = token(text, buffer, false);
    if (n == 0)
        return false;
    char *end = NULL;
    const double value = strtod(buffer, &end);
    if (end != buffer + n || !isfinite(value))
        return false;
    text->at += n;
    *out_value = value;
    return true;
}

bool number_text_integer(struct number_text *text, int64_t *out_value) {
    char buffer[TOKEN_MAX];
    const size_t n = token(text, buffer, true);
    if (n == 0)
        return false;
    char *end = NULL;
    errno = 0;
    const long long value = strtoll(buffer, &end, 10);
    if (end != buffer + n || errno)
        return false;
    text->at += n;
    *out_value = value;
    return true;
}
