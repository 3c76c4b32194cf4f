#include "core.h"
int main(int c,char**v){auto runs=load(v[1]);auto geo=loadgeo((string(v[1])+".geo").c_str());
 struct S{int n=0,sh=0,lo=0,ok=0;};map<string,map<int,S>> st;
 for(auto&r:runs){auto&sg=geo[r.key];for(auto&g:r.segs)for(auto&x:g)for(auto&q:x.rays){
   double t=castray(sg,x.T.x,x.T.y,x.T.h+q.a);
   // allow +-3 degrees
   double lo=t,hi=t;for(int i=-2;i<=2;i++){double u=castray(sg,x.T.x,x.T.y,x.T.h+q.a+i*.026);lo=min(lo,u);hi=max(hi,u);}
   double tol=.15+.08*q.d;
   string nm=string(1,x.tag)+(q.rec?" recall":q.k?" known ":" hidden");int b=(int)(q.d/.5);if(b>8)b=8;
   S&s=st[nm][b];s.n++;
   if(q.k){if(q.d<lo-tol)s.sh++;else if(q.d>hi+tol)s.lo++;else s.ok++;}
   else{ if(lo>q.near_+.1)s.sh++;else s.ok++;}
 }}
 for(auto&[nm,m]:st)for(auto&[b,s]:m)printf("%s %.1f m: n %6d short %.3f long %.3f\n",nm.c_str(),b*.5,s.n,double(s.sh)/s.n,double(s.lo)/s.n);}
