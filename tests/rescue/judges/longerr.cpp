#include "core.h"
using std::map;
int main(int c,char**v){map<int,array<int,6>> h;for(int k=1;k+1<c;k+=2){auto runs=load(v[k]);auto geo=loadgeo(v[k+1]);for(auto&r:runs){auto&s=geo[r.key];for(auto&sg:r.segs)for(auto&q:sg)if(q.tag=='S')for(auto&y:q.rays){if(!y.k)continue;double t=castray(s,q.T.x,q.T.y,q.T.h+y.a);double f=y.d/t;auto&a=h[(int)(min(t,4.)*2)];a[f<.9?0:f<1.1?1:f<1.25?2:f<1.5?3:f<2?4:5]++;}}}
 for(auto&[k,a]:h){int n=0;for(int x:a)n+=x;printf("true %.1f n %5d  short>10%% %.2f  ok %.2f  1.1-1.25 %.2f 1.25-1.5 %.2f 1.5-2 %.2f >2 %.2f\n",k/2.,n,a[0]/(double)n,a[1]/(double)n,a[2]/(double)n,a[3]/(double)n,a[4]/(double)n,a[5]/(double)n);}}
