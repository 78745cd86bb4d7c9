/* A division of binary64 by the processor's division of 32 bits, rounded to nearest, ties to even.
 *
 * With normal numbers and a normal quotient, the quotient is 1 and five digits of eleven bits; each is
 * at most one below (R >> 21) / ((D >> 32) + 1), R being what is left and D the divisor. The
 * compiler's own division, which goes bit by bit, is left to the rest. */
#include "rounding.h"

enum { LAST_EXPONENT = 0x7fe, BIAS = 1023, DIGITS = 5, DIGIT = 11 };

double divide(double a, double b)
{
    uint64_t n, d;
    memcpy(&n, &a, 8), memcpy(&d, &b, 8);
    uint32_t sign = (uint32_t)((n ^ d) >> 32) & 0x80000000;
    uint32_t n_exponent = (uint32_t)(n >> 52) & 0x7ff, d_exponent = (uint32_t)(d >> 52) & 0x7ff;
    int32_t exponent = (int32_t)n_exponent - (int32_t)d_exponent + BIAS;
    if (n_exponent - 1 >= LAST_EXPONENT || d_exponent - 1 >= LAST_EXPONENT || exponent < 2 ||
        exponent > LAST_EXPONENT)
        return a / b;
    const uint64_t hidden = 1ULL << 52;
    n = (n & (hidden - 1)) | hidden, d = (d & (hidden - 1)) | hidden;
    if (n < d)
        n <<= 1, exponent -= 1;
    n -= d;
    uint64_t quotient = 1;
    uint32_t estimate = (uint32_t)(d >> 32) + 1;
    for (int k = 0; k < DIGITS; k++) {
        uint32_t digit = (uint32_t)(n >> 21) / estimate;
        n = (n << DIGIT) - digit * d;
        if (n >= d)
            n -= d, digit += 1;
        quotient = quotient << DIGIT | digit;
    }
    uint32_t rest = (uint32_t)quotient & 7;
    quotient = quotient >> 3 & (hidden - 1);
    quotient |= (uint64_t)(sign | (uint32_t)exponent << 20) << 32;
    quotient += rest > 4 || (rest == 4 && (n != 0 || (quotient & 1)));
    memcpy(&a, &quotient, 8);
    return a;
}
